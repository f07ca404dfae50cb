"""Statistics: checked against the tables, across chunks of events and borders of windows."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.statistics import Accumulator
from mems_impact.systems.window_statistics import TimeWindow

ZHAO = mi.load_actuator("zhao2004")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
# Chatter, rest contact and slips that are long enough to lie across borders.
SLIPPERY = ZHAO.replace(mu_s=0.01, mu_d=0.01)
SLOW = mi.Sine(amplitude=0.45, omega=0.1)
BORDERS = (np.zeros(4), np.array([1.0, 0.0, 0.0, 0.0]))  # between them the frame moves by 1


@pytest.fixture(scope="module")
def chattering():
    return mi.simulate(SLIPPERY, SLOW, 12, initial=mi.State(v2=1.0), window=(2, 12))


def gathered(run, window, sizes):
    """Return the accumulator of a run whose events come in chunks of these sizes."""
    start = run.trajectory.start
    accumulator = Accumulator(run.actuator, start, TimeWindow(*window, run.drive.period))
    events, done = run.trajectory.events, 0
    for size in sizes:
        accumulator(events[done : done + size])
        done += size
    accumulator(events[done:])
    return accumulator


def test_against_the_tables(chattering):
    run, number = chattering, chattering.statistics
    hits = run.impacts[run.impacts["period"] >= 2]
    assert number["impacts"] == len(hits)
    assert number["impacts per period"] == len(hits) / 10
    speeds = hits["v2 before"].abs()
    assert number["impact speed min"] == speeds.min()
    assert number["impact speed max"] == speeds.max()
    assert number["impact speed mean"] == pytest.approx(speeds.mean(), rel=1e-13)
    assert number["displacement per impact std"] == pytest.approx(
        hits["step"].std(ddof=0), rel=1e-12
    )
    ends = run.events[(run.events["event"] == "chatter ends") & (run.events["period"] >= 2)]
    assert number["chatter sequences"] == len(ends) > 0
    assert math.isnan(number["closest approach"])
    x1 = run.samples(1, 2)["x1"]
    displacement = x1.iloc[-1] - x1.iloc[0]
    assert number["displacement per period"] == pytest.approx(displacement / 10, rel=1e-12)
    assert number["displacement per impact"] == pytest.approx(displacement / len(hits), rel=1e-12)
    duration = 10 * SLOW.period
    assert number["mean speed"] == pytest.approx(displacement / duration, rel=1e-12)
    assert number["energy lost per period"] == pytest.approx(hits["energy lost"].sum() / 10, 1e-8)


def test_blows_against_their_table(chattering):
    run, number = chattering, chattering.statistics
    whole = run.blows
    assert whole["impacts"].sum() == len(run.impacts)
    assert whole["displacement"].sum() == pytest.approx(run.impacts["step"].sum(), rel=1e-12)
    assert whole["ends in rest"].sum() == (run.events["event"] == "chatter ends").sum()
    table = whole[whole["period"] >= 2]
    assert 0 < number["blows"] == len(table) < number["impacts"]
    assert number["blows per period"] == len(table) / 10
    displacement = 10 * number["displacement per period"]
    assert number["displacement per blow"] == pytest.approx(displacement / len(table), rel=1e-12)
    assert number["displacement per blow std"] == pytest.approx(
        table["displacement"].std(ddof=0), rel=1e-12
    )
    assert number["displacement per blow std"] > number["displacement per impact std"] > 0.0
    found = run.blow_statistics
    assert found.count == len(table)
    assert found.displacement_per_blow == number["displacement per blow"]
    assert found.displacement_std == number["displacement per blow std"]


def test_a_blow_counts_where_its_first_impact_is(chattering):
    hits = chattering.impacts
    blow = chattering.blows.iloc[5]
    bounces = hits[(hits["period"] == blow["period"]) & (hits["time"] >= blow["time"])]
    assert blow["impacts"] > 3
    middle = blow["period"] + bounces["time"].iloc[1:3].mean() / SLOW.period
    first, last = (
        mi.simulate(SLIPPERY, SLOW, 12, initial=mi.State(v2=1.0), window=window).statistics
        for window in ((0, middle), (middle, 12))
    )
    assert first["blows"] == 6
    assert first["blows"] + last["blows"] == len(chattering.blows)
    assert last["impacts"] > last["blows"]


def test_a_sequence_that_the_run_cuts_short_is_no_blow_yet(chattering):
    blow = chattering.blows.iloc[5]
    hits = chattering.impacts
    bounces = hits[(hits["period"] == blow["period"]) & (hits["time"] >= blow["time"])]
    middle = blow["period"] + bounces["time"].iloc[2:4].mean() / SLOW.period
    cut = mi.simulate(SLIPPERY, SLOW, middle, initial=mi.State(v2=1.0), window=(0, middle))
    assert cut.statistics["blows"] == len(cut.blows) == 5 + 3
    assert cut.blows["ends in rest"].tolist()[-3:] == [False] * 3


def test_shares_of_time(chattering):
    # Sampled: each of the few intervals is known to a sample.
    modes = chattering.samples(20_000, 2, 12)["mode"].astype(str)
    stuck = modes.str.startswith("stuck")
    free = modes.str.endswith("free")
    number = chattering.statistics
    assert number["share slipping"] == pytest.approx(1 - stuck.mean(), abs=1e-3)
    assert number["share resting"] == pytest.approx(1 - free.mean(), abs=1e-3)
    assert number["share slipping"] > 0.01
    assert number["share resting"] > 0.1


@pytest.mark.parametrize("sizes", [[1] * 400, [7] * 50, [3, 500, 1, 1, 20]])
def test_chunks_do_not_matter(chattering, sizes):
    run = chattering
    whole = gathered(run, (2, 12), []).result(run.trajectory.final, BORDERS)
    split = gathered(run, (2, 12), sizes).result(run.trajectory.final, BORDERS)
    assert split == pytest.approx(whole, rel=1e-12, abs=1e-15, nan_ok=True)


def test_a_step_may_end_in_the_next_chunk():
    run = mi.simulate(ZHAO, DRIVE, 20, initial=mi.State(v2=1.0))
    kinds = run.trajectory.events.kind
    first = int(np.flatnonzero(kinds == 0)[0]) + 1  # cut between an impact and the rest after it
    whole = gathered(run, (0, 20), []).result(run.trajectory.final, BORDERS)
    split = gathered(run, (0, 20), [first]).result(run.trajectory.final, BORDERS)
    assert split["blows"] == whole["blows"]
    assert split["displacement per impact std"] == pytest.approx(
        whole["displacement per impact std"], rel=1e-12
    )
    assert whole["displacement per impact std"] > 0.0


@pytest.mark.quick(1)
@pytest.mark.parametrize("keep", ["events", "statistics"])
def test_windows_add_up(keep, chattering):
    # 0.9 of a forcing period is within a slip here: x1 at the border is integrated anew.
    sliding = chattering.events
    slip = sliding[(sliding["period"] == 5) & sliding["event"].str.endswith("impact")].iloc[0]
    inside = 5 + (slip["time"] + 1e-3) / SLOW.period

    def over(*window):
        run = mi.simulate(SLIPPERY, SLOW, 12, initial=mi.State(v2=1.0), window=window, keep=keep)
        return run.statistics

    left, right, both = over(2, inside), over(inside, 12), over(2, 12)
    assert left["impacts"] + right["impacts"] == both["impacts"]
    for name in ("displacement per period", "energy lost per period", "share slipping",
                 "share resting"):  # fmt: skip
        sum_ = left[name] * (inside - 2) + right[name] * (12 - inside)
        assert sum_ == pytest.approx(both[name] * 10, rel=1e-9), name


def test_position_at_a_border_within_a_slip(chattering):
    events = chattering.events
    slip = events[(events["period"] == 5) & events["event"].str.endswith("impact")].iloc[0]
    fractions = (slip["time"] + 2e-2) / SLOW.period
    per_period = 4000
    border = 5 + math.ceil(fractions * per_period) / per_period
    run = mi.simulate(SLIPPERY, SLOW, 12, initial=mi.State(v2=1.0), window=(border, 12))
    x1 = run.samples(per_period, border, 12)
    assert not x1["mode"].iloc[0].startswith("stuck")
    moved = (x1["x1"].iloc[-1] - x1["x1"].iloc[0]) / (12 - border)
    assert run.statistics["displacement per period"] == pytest.approx(moved, rel=1e-9)


@pytest.mark.quick(4)
@pytest.mark.parametrize("window", [None, (3, 9), (0, 12), (4.25, 8.5)])
@pytest.mark.parametrize(("actuator", "drive"), [(ZHAO, DRIVE), (SLIPPERY, SLOW)])
def test_both_ways_of_keeping_are_the_same(actuator, drive, window):
    runs = [
        mi.simulate(actuator, drive, 12, initial=mi.State(v2=1.0), window=window, keep=keep)
        for keep in ("events", "statistics")
    ]
    assert runs[0].statistics.equals(runs[1].statistics)
    assert runs[0].final == runs[1].final


def test_without_impact():
    number = mi.simulate(ZHAO, DRIVE.replace(amplitude=0.16), 400).statistics
    assert number["window first"] == 200
    assert number["window last"] == 400
    assert number["impacts"] == 0
    assert number["displacement per period"] == 0.0
    assert number["share slipping"] == 0.0
    assert number["share resting"] == 0.0
    for name in ("displacement per impact", "displacement per impact std",
                 "displacement per blow", "displacement per blow std",
                 "impact speed mean"):  # fmt: skip
        assert math.isnan(number[name])
    grid = mi.simulate(ZHAO, DRIVE.replace(amplitude=0.16), 400).samples(500, 200)
    gap = ZHAO.delta - grid["x2"].abs().max()
    assert number["closest approach"] == pytest.approx(gap, abs=1e-5)
    assert number["closest approach"] <= gap


def test_block_that_never_moves_is_close_to_nothing():
    number = mi.simulate(ZHAO, DRIVE.replace(amplitude=0.0), 2).statistics
    assert math.isnan(number["closest approach"])
