"""A run beside the same run by an unrelated method, and runs that were tampered with."""

from dataclasses import fields, replace

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.impact_statistics import is_impact
from mems_impact.analysis.verification import other_family
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import Events

ZHAO = mi.load_actuator("zhao2004")
PERIODIC = mi.Sine(amplitude=0.24, omega=0.5)
CHAOTIC = mi.Sine(amplitude=0.26, omega=0.45)
STATES = ["x1 apart", "v1 apart", "x2 apart", "v2 apart"]
DIFFERENCES = ["time apart", "impact speed apart", *STATES]


@pytest.fixture(scope="module")
def periodic():
    return mi.simulate(ZHAO, PERIODIC, periods=60)


@pytest.fixture(scope="module")
def chaotic():
    return mi.simulate(ZHAO, CHAOTIC, periods=100)


def impact_rows(run):
    return np.flatnonzero(is_impact(run.trajectory.events))


def with_events(run, change):
    """Return the run with every column of its events changed."""
    events = run.trajectory.events
    changed = Events(*(change(getattr(events, column.name)) for column in fields(Events)))
    return replace(run, trajectory=replace(run.trajectory, events=changed))


def with_column(run, name, row, by):
    column = np.copy(getattr(run.trajectory.events, name))
    column[row] += by
    events = replace(run.trajectory.events, **{name: column})
    return replace(run, trajectory=replace(run.trajectory, events=events))


@pytest.mark.parametrize("method", ["adams", "bdf", "dop853"])
def test_a_periodic_motion_agrees_to_the_end(method):
    run = mi.simulate(ZHAO, PERIODIC, periods=40, options=mi.Options(method=method))
    found = run.verify()
    assert found.agrees
    assert found.horizon == 40.0
    assert found.verdict == "agree to the end, period 40"
    table = found.table.set_index("event")
    assert table.loc["right impact", "matched"] == len(run.impacts)
    assert table["matched"].sum() == len(run.events) + 1
    assert table["in one run only"].sum() == 0
    # Two methods never give the very same numbers.
    assert 0.0 < table.loc["right impact", "time apart"] < 1e-6
    assert table[DIFFERENCES].max().max() < 1e-6


def test_a_run_without_events_is_judged_by_its_end():
    run = mi.simulate(ZHAO, mi.Sine(amplitude=0.05, omega=0.5), periods=20)
    found = run.verify()
    assert list(found.table["event"]) == ["end of the run"]
    assert found.agrees
    moved = replace(run.trajectory.final, y=run.trajectory.final.y + 1e-3)
    moved_run = replace(run, trajectory=replace(run.trajectory, final=moved))
    assert not moved_run.verify().agrees


def test_a_chaotic_motion_agrees_as_far_as_it_can_be_compared(chaotic):
    found = chaotic.verify()
    assert found.agrees
    assert 10.0 < found.horizon < 40.0
    assert "too sensitive" in found.verdict
    assert f"until period {found.horizon:.4g};" in found.verdict
    # Nothing beyond is in the table: the motions have nothing more to do with each other.
    assert found.table[DIFFERENCES].max().max() < 1e-2


def test_a_more_precise_run_of_it_agrees_longer(chaotic):
    fine = mi.simulate(ZHAO, CHAOTIC, periods=100, options=mi.Options(rtol=1e-12, atol=1e-14))
    assert fine.verify().horizon > chaotic.verify().horizon + 3.0


@pytest.mark.parametrize("motion", ["periodic", "chaotic"])
@pytest.mark.parametrize("kind", ["an impact", "an impact and its slip"])
def test_a_lost_event_is_found(motion, kind, request):
    run = request.getfixturevalue(motion)
    row = impact_rows(run)[6]
    last = row + (1 if kind == "an impact" else 2)
    found = with_events(run, lambda column: np.delete(column, slice(row, last), axis=0)).verify()
    assert not found.agrees
    assert "right impact" in found.verdict
    assert found.horizon < run.impacts["period"][6] + run.impacts["phase"][6]


@pytest.mark.parametrize("motion", ["periodic", "chaotic"])
@pytest.mark.parametrize("after_impact", [0, 1], ids=["impact", "slip end"])
def test_a_doubled_event_is_found(motion, after_impact, request):
    run = request.getfixturevalue(motion)
    events = run.trajectory.events
    row = impact_rows(run)[6] + after_impact
    found = with_events(run, lambda column: np.insert(column, row, column[row], axis=0)).verify()
    assert not found.agrees
    instant = events.cycle[row] + events.time[row] / run.trajectory.period
    assert found.horizon == pytest.approx(instant)


@pytest.mark.parametrize(
    ("name", "by"),
    [("time", 1e-3), ("after", [0.0, 0.0, 0.0, 1e-3]), ("before", [0.0, 0.0, 0.0, 1e-3])],
)
@pytest.mark.parametrize("motion", ["periodic", "chaotic"])
def test_a_shifted_impact_is_found(motion, name, by, request):
    run = request.getfixturevalue(motion)
    found = with_column(run, name, impact_rows(run)[5], by).verify()
    assert not found.agrees
    assert found.verdict.startswith("do not agree: 'right impact'")


def test_a_lost_switch_of_the_drive_is_found():
    run = mi.simulate(ZHAO, mi.Square(amplitude=0.2, omega=0.5), periods=10)
    assert run.verify().agrees
    row = np.flatnonzero(run.trajectory.events.kind == workspace.SWITCH)[5]
    found = with_events(run, lambda column: np.delete(column, row, axis=0)).verify()
    assert not found.agrees
    assert "drive switches" in found.verdict


def test_weak_impacts_that_one_run_has_alone_are_counted():
    # Sequences that end in rest: how many of their last impacts are told apart is a matter of
    # precision, where the tolerance is loose.
    mita = mi.load_actuator("mita2003")
    loose = mi.Options(rtol=1e-7, atol=1e-9)
    run = mi.simulate(mita, mi.Sine(amplitude=100, omega=2 * np.pi), periods=3, options=loose)
    found = run.verify()
    assert found.agrees
    table = found.table.set_index("event")
    weak = table["in one run only"].sum()
    assert found.verdict == f"agree to the end, period 3; weak events in one run only: {weak}"
    assert table.loc["right impact", "in one run only"] > 0
    assert table.loc["chatter ends", "in one run only"] == 0
    chatter = (run.events["event"] == "chatter ends").sum()
    assert table.loc["chatter ends", "matched"] == chatter
    # In SI, like all tables of this device: nanometres, microseconds.
    assert table[["x1 apart", "x2 apart"]].max(axis=None) < 1e-11
    assert table["time apart"].max() < 1e-5
    units = dict(zip(DIFFERENCES, ["s", "m/s", "m", "m/s", "m", "m/s"], strict=True))
    assert found.table.attrs["units"] == units


def test_a_lost_rest_is_found():
    mita = mi.load_actuator("mita2003")
    run = mi.simulate(mita, mi.Sine(amplitude=100, omega=2 * np.pi), periods=3)
    events = run.trajectory.events
    row = np.flatnonzero(events.kind == workspace.ACCUMULATION)[0]
    found = with_events(run, lambda column: np.delete(column, row, axis=0)).verify()
    assert not found.agrees
    rest = events.cycle[row] + events.time[row] / run.trajectory.period
    assert found.horizon == pytest.approx(rest, abs=1e-6)


@pytest.mark.parametrize(
    ("e", "amplitude", "omega", "rtol"),
    [
        # The first event comes after 40 periods, in which BDF's errors add up to 700 rtol.
        (0.43979794875092204, 0.2029387239439694, 0.4671674055252111, 1e-10),
        # Ten periods without an impact on an unstable silent orbit: differences grow by 350.
        (0.8322958164673084, 0.2861156301218294, 0.41645404355099885, 1e-9),
    ],
)
def test_errors_of_a_long_smooth_motion_may_grow(e, amplitude, omega, rtol):
    slippery = ZHAO.replace(e=e, mu_s=0.02, mu_d=0.01)
    drive = mi.Sine(amplitude=amplitude, omega=omega)
    options = mi.Options(method="bdf", rtol=rtol, atol=0.01 * rtol)
    assert mi.simulate(slippery, drive, periods=60, options=options).verify().agrees


def test_a_rest_that_a_switch_cuts_off_may_be_in_one_run_only():
    """The impacts accumulate some 1e-3 before the drive switches, and by so much runs differ."""
    drive = mi.Square(amplitude=0.36804725717836306, omega=0.5309525562805197)
    options = mi.Options(rtol=1e-6, atol=1e-8)
    run = mi.simulate(ZHAO.replace(e=0.7344092758445073), drive, periods=20, options=options)
    found = run.verify()
    assert found.agrees
    table = found.table.set_index("event")
    assert table.loc["chatter ends", "in one run only"] == 1


def test_the_same_start_and_length_are_verified():
    start = mi.State(x2=0.1, v2=0.05, time=1.0)
    run = mi.simulate(ZHAO, PERIODIC, periods=20.3, initial=start)
    found = run.verify()
    assert found.agrees
    assert found.horizon == pytest.approx(run.extent[1], abs=1e-12)
    other = replace(run, system=run.system.changed(amplitude=0.2401))
    assert not other.verify().agrees


@pytest.mark.parametrize("late", [-1e-9, 1e-9])
def test_an_event_at_the_very_end_may_be_in_one_run_only(periodic, late):
    last = periodic.impacts.iloc[-1]
    end = last["period"] + last["phase"] + late / periodic.trajectory.period
    run = mi.simulate(ZHAO, PERIODIC, periods=end)
    # The instants of the two differ by 5e-9, which is more than what is left of the run.
    assert run.verify().agrees
    assert run.verify().horizon == pytest.approx(end)


def test_a_start_on_a_stopper_strikes_in_both_runs():
    against = mi.State(x2=ZHAO.delta, v2=0.2)
    found = mi.simulate(ZHAO, PERIODIC, periods=5, initial=against).verify()
    assert found.verdict == "agree to the end, period 5"


def test_a_run_of_another_automaton_does_not_agree():
    """An error of the model in one run shows from the first impact on."""
    run = mi.simulate(ZHAO, PERIODIC, periods=30)
    assert not replace(run, system=run.system.changed(e=0.81)).verify().agrees


@pytest.mark.parametrize(
    ("method", "other"),
    [("adams", "dop853"), ("bdf", "dop853"), ("dop853", "adams"), ("auto", "adams")],
)
def test_the_other_method_is_more_precise(method, other):
    options = other_family(mi.Options(method=method, rtol=1e-9, atol=1e-10))
    assert options.method == other
    stiff = other_family(mi.Options(method=method), stiff=True).method
    assert stiff == {"dop853": "auto", "adams": "bdf"}[other]
    assert options.rtol == pytest.approx(1e-11)
    assert options.atol == pytest.approx(1e-12)


def test_tolerances_stay_above_rounding():
    finest = other_family(mi.Options(rtol=1e-12, atol=1e-14))
    assert (finest.rtol, finest.atol) == (1e-13, 1e-15)
    finer = other_family(mi.Options(rtol=1e-14, atol=1e-16))
    assert (finer.rtol, finer.atol) == (1e-14, 1e-16)


def test_events_are_needed():
    run = mi.simulate(ZHAO, PERIODIC, periods=5, keep="statistics")
    with pytest.raises(mi.InvalidParameter, match="verification"):
        run.verify()


def test_table_and_verdict_are_shown(periodic):
    shown = str(periodic.verify()).splitlines()
    assert shown[0].split()[:2] == ["event", "matched"]
    assert shown[-1] == "agree to the end, period 60"
    assert "NaN" not in "".join(shown)
