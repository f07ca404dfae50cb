"""Design formulas against the simulation, and the mita2003 preset against its experiment."""

import math

import numpy as np
import pytest

import mems_impact as mi
from tests.actuator.slipping import PULLED, SLIPPING

INTERPRETED = mi.Options(method="dop853", engine="interpreted")
PAPER = mi.load_actuator("zhao2004")
MITA = mi.load_actuator("mita2003")


@pytest.mark.nightly
def test_pull_in_is_where_the_slow_device_switches_on():
    voltage = mi.pull_in_voltage(PAPER)
    assert math.isclose(voltage, math.sqrt(4 / 27))
    assert math.isclose(mi.resting_voltage(PAPER), math.sqrt(0.5) * 0.5)
    slow = mi.Sine(amplitude=1.0, omega=1e-3)
    for factor, count in ((0.995, 0), (1.005, 1)):
        drive = slow.replace(amplitude=factor * voltage)
        run = mi.simulate(PAPER.replace(c=0.5), drive, 2.5, initial=mi.State(time=1570.0))
        assert run.statistics["chatter sequences"] >= count
        assert (run.statistics["impacts"] > 0) == bool(count)


def test_pull_in_with_a_near_stopper_is_resting():
    near = PAPER.replace(delta=0.3)
    assert mi.pull_in_voltage(near) == mi.resting_voltage(near)
    edge = PAPER.replace(delta=1 / 3)
    # Both formulas meet at delta = d/3.
    assert math.isclose(mi.resting_voltage(edge), math.sqrt(4 / 27), rel_tol=1e-12)


@pytest.mark.parametrize("side", [-1, 1])
def test_block_rests_above_the_resting_voltage(side):
    voltage = mi.resting_voltage(MITA) * (1 + 1e-6 * side)
    drive = mi.Sine(amplitude=0.0, omega=1.0 / MITA.scales.time, bias=voltage)
    run = mi.simulate(MITA, drive, 1, initial=mi.State(x2=MITA.delta))
    assert run.statistics["share resting"] == (1.0 if side > 0 else 0.0)


def test_step_formula_agrees_with_weak_impacts():
    # At the end of a chatter sequence the load hardly changes during the slide.
    run = mi.simulate(MITA, mi.Sine(amplitude=100.0, omega=2 * math.pi), 3)
    table = run.step_lengths()
    units = {"v2 before": "m/s", "voltage": "V", "step": "m", "formula": "m"}
    assert table.attrs["units"] == units
    assert abs(table["ratio"].iloc[0] - 1) < 0.02
    weak = table[table["v2 before"].between(1e-6, 1e-4)]
    assert len(weak) > 5
    np.testing.assert_allclose(weak["ratio"], 1.0, atol=1e-3)


def test_step_formula_of_the_paper_set():
    run = mi.simulate(PAPER, mi.Sine(amplitude=0.24, omega=0.5), 100)
    table = run.step_lengths()
    assert abs(table["ratio"].iloc[-1] - 1) < 0.02
    assert mi.step_length(PAPER, 0.0) == 0.0
    assert mi.step_length(PAPER.replace(mu_d=0.0), 0.1) == math.inf
    assert mi.step_length(PAPER, [0.1, 0.2], 0.3).shape == (2,)


def test_no_steps_say_why():
    run = mi.simulate(SLIPPING, PULLED, 12, options=INTERPRETED)
    with pytest.raises(mi.InvalidParameter, match=r"already slips .* run\.blow_statistics"):
        run.step_lengths()
    assert run.blow_statistics.displacement_per_blow != 0.0
    quiet = mi.simulate(SLIPPING, PULLED.replace(amplitude=10.0), 2, options=INTERPRETED)
    with pytest.raises(mi.InvalidParameter, match="no impact on the right stopper; raise"):
        quiet.step_lengths()
    struck = mi.simulate(PAPER, mi.Sine(amplitude=0.24, omega=0.5), 0.085,
                         initial=mi.kicked_state(PAPER), options=INTERPRETED)  # fmt: skip
    with pytest.raises(mi.InvalidParameter, match=r"no step of 1 .* more periods"):
        struck.step_lengths()


@pytest.mark.nightly
def test_period_one_window_of_type_two():
    drive = mi.Sine(amplitude=0.18, omega=0.485)
    window = mi.period_one_window(PAPER, drive, (0.16, 0.19))
    assert (window.low_kind, window.high_kind) == ("period-doubling", "bound")
    assert abs(window.low - 0.176318773) < 1e-8
    assert window.high == 0.19
    assert math.isclose(window.margin, (0.19 - window.low) / (0.19 + window.low))
    with pytest.raises(mi.InvalidParameter, match="amplitude"):
        mi.period_one_window(PAPER, drive, (0.19, 0.2))


def test_a_window_from_a_motion_without_impacts():
    """From rest the block does not strike, although the orbit with impacts is stable."""
    drive = mi.Sine(amplitude=0.2, omega=0.5)
    with pytest.raises(mi.OrbitError, match="leads to an orbit that is without impacts"):
        mi.period_one_window(PAPER, drive, (0.17, 0.25), guess=mi.State())


def test_preset_does_what_was_measured():
    run = mi.simulate(MITA, mi.Sine(amplitude=100.0, omega=2 * math.pi), 8, window=(2, 8))
    found = run.blow_statistics
    assert abs(found.displacement_per_blow / 20e-9 - 1) < 0.01
    assert found.per_period == 1.0  # two in a cycle of the voltage, which is two forcing periods
    assert run.statistics["chatter sequences"] == found.count
    assert (run.impacts["stopper"] == "right").all()
    assert run.statistics["share resting"] > 0.5


def test_the_step_of_a_slow_device_grows_with_the_rate_of_the_voltage():
    def step(volts, hertz):
        run = mi.simulate(MITA, mi.Sine(amplitude=volts, omega=2 * math.pi * hertz), 4,
                          window=(2, 4))  # fmt: skip
        return run.blow_statistics.displacement_per_blow

    assert step(31.0, 1) == 0.0  # pull-in is at 31.6 V
    assert step(33.0, 1) < step(60.0, 1) < step(100.0, 1) < step(150.0, 1)
    assert step(100.0, 0.1) < 0.6 * step(100.0, 1)


def test_blows_without_rest_are_impacts():
    run = mi.simulate(PAPER, mi.Sine(amplitude=0.24, omega=0.5), 100, window=(50, 100))
    found = run.blow_statistics
    assert found.count == 50
    assert found.displacement_std < 1e-12
    assert found.displacement_per_blow == run.statistics["displacement per impact"]
    quiet = mi.simulate(PAPER, mi.Sine(amplitude=0.1, omega=0.5), 10).blow_statistics
    assert (quiet.count, quiet.displacement_per_blow) == (0, 0.0)
    assert math.isnan(quiet.displacement_std)


@pytest.mark.nightly
def test_a_chart_of_a_device_whose_frame_slips_first(tmp_path):
    omegas = (2.0 * math.pi * 460.0, 2.0 * math.pi * 500.0)
    chart = mi.operating_chart(SLIPPING, omega=omegas, crises=2, periods=300)
    assert chart.notes == ()
    assert len(chart.types) == 0
    table = chart.table.pivot_table(index="omega", columns="boundary", values="amplitude")
    curve = table["slip"].dropna()
    table = table.loc[[curve.index[0], curve.index[-1]]]
    assert table.index.to_list() == pytest.approx(omegas)
    chart.save(tmp_path / "chart.zip")
    assert mi.load(tmp_path / "chart.zip") == chart
    labels = {line.get_label() for line in mi.plot_chart(chart).lines}
    assert labels >= {"on", "off", "the frame slips", "steady from", "steady to"}

    def run(omega, amplitude, start, periods=600):
        drive = mi.Sine(amplitude=amplitude, omega=omega)
        window = (periods - 200, periods)
        return mi.simulate(SLIPPING, drive, periods, initial=start, window=window)

    def moved(omega, amplitudes, state):
        for amplitude in amplitudes.tolist():
            last = run(omega, amplitude, state, 200)
            state = last.final
        return last

    def slips_at(omega, amplitude):
        # Raised slowly from rest, lest the block overshoot: the frame is held, and slips above.
        held = moved(omega, np.linspace(0.05, 0.97, 20) * amplitude, mi.State())
        assert held.statistics["share slipping"] == 0.0
        slips = run(omega, 1.001 * amplitude, held.final)
        assert slips.statistics["share slipping"] > 0.0
        return slips

    # The curve between the two frequencies is far from the line that joins its ends.
    between = curve.index[int(np.argmin(curve.to_numpy()))]
    assert curve[between] < 0.9 * min(curve.iloc[0], curve.iloc[-1])
    slips_at(between, curve[between])
    for omega, row in table.iterrows():
        slips = slips_at(omega, row["slip"])
        # Raised to just below and above from the slip, and lowered from the impacts.
        below = moved(omega, np.linspace(row["slip"], 0.999 * row["on"], 10), slips.final)
        assert below.statistics["impacts"] == 0
        above = run(omega, 1.001 * row["on"], below.final)
        assert above.statistics["impacts"] > 0
        down = moved(omega, np.linspace(row["on"], 1.002 * row["off"], 10), above.final)
        assert down.statistics["impacts"] > 0
        assert run(omega, 0.99 * row["off"], down.final).statistics["impacts"] == 0
    orbit = mi.find_orbit(SLIPPING, PULLED, guess=mi.kicked_state(SLIPPING), transient=300)
    doublings = chart.table[chart.table["kind"] == "period-doubling"]
    for side, inwards in (("steady from", 1.0), ("steady to", -1.0)):
        for _, row in doublings[doublings["boundary"] == side].iloc[::4].iterrows():
            # One impact a period, always as fast, on the one side; two in turn on the other.
            turns = []
            inside = row["amplitude"] * (1.0 + inwards * 0.01)
            state = orbit.state
            for part in np.linspace(0.0, 1.0, 12):
                amplitude = PULLED.amplitude + part * (inside - PULLED.amplitude)
                omega = PULLED.omega + part * (row["omega"] - PULLED.omega)
                state = run(omega, amplitude, state, 200).final
            for amplitude in (inside, row["amplitude"] * (1.0 - inwards * 0.01)):
                events = run(row["omega"], amplitude, state).events
                speeds = events.loc[events["event"] == "right impact", "v2"].tail(20).to_numpy()
                turns.append(np.median(np.abs(np.diff(speeds))) / np.abs(speeds).max())
            assert turns[0] < 1e-6
            assert turns[1] > 1e-3
