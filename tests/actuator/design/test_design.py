"""Design formulas against the simulation, and the mita2003 preset against its experiment."""

import math

import numpy as np
import pytest

import mems_impact as mi

PAPER = mi.load_actuator("zhao2004")
MITA = mi.load_actuator("mita2003")


@pytest.mark.slow
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
    table = mi.step_lengths(run)
    units = {"v2 before": "m/s", "voltage": "V", "step": "m", "formula": "m"}
    assert table.attrs["units"] == units
    assert abs(table["ratio"].iloc[0] - 1) < 0.02
    weak = table[table["v2 before"].between(1e-6, 1e-4)]
    assert len(weak) > 5
    np.testing.assert_allclose(weak["ratio"], 1.0, atol=1e-3)


def test_step_formula_of_the_paper_set():
    run = mi.simulate(PAPER, mi.Sine(amplitude=0.24, omega=0.5), 100)
    table = mi.step_lengths(run)
    assert abs(table["ratio"].iloc[-1] - 1) < 0.02
    assert mi.step_length(PAPER, 0.0) == 0.0
    assert mi.step_length(PAPER.replace(mu_d=0.0), 0.1) == math.inf
    assert mi.step_length(PAPER, [0.1, 0.2], 0.3).shape == (2,)


@pytest.mark.slow
def test_speed_over_the_voltage_of_one_side():
    one = mi.Sine(amplitude=0.24, omega=0.5)
    pair = mi.TwoSided(right=one, left=mi.Sine(amplitude=1e-9, omega=0.5))
    settings = {"transient": 200, "periods": 10}
    alone = mi.speed_over_voltage(PAPER, one, [0.2, 0.24], **settings)
    right = mi.speed_over_voltage(PAPER, pair, [0.2, 0.24], parameter="right.amplitude", **settings)
    assert right.columns[0] == "right.amplitude"
    np.testing.assert_allclose(right.to_numpy(), alone.to_numpy(), rtol=1e-6)


def test_speed_over_voltage_and_resolution():
    drive = mi.Sine(amplitude=0.24, omega=0.5)
    table = mi.speed_over_voltage(PAPER, drive, [0.16, 0.18, 0.24], transient=200, periods=10)
    assert table["amplitude"].tolist() == [0.16, 0.18, 0.24]
    assert table["displacement per period"][0] == 0.0
    assert math.isnan(table["displacement per impact"][0])
    ratio = table["displacement per period"] / table["mean speed"]
    assert math.isclose(ratio[2], drive.period)
    smallest = mi.resolution(table)
    assert smallest == table["displacement per blow"][1] == table["displacement per impact"][1]
    assert 0.0 < smallest < table["displacement per blow"][2]


def test_resolution_of_a_device_that_bounces():
    drive = mi.Sine(amplitude=100.0, omega=2 * math.pi)
    table = mi.speed_over_voltage(MITA, drive, [60.0, 100.0], transient=2, periods=2)
    assert table["blows per period"].tolist() == [1.0, 1.0]
    assert (table["impacts per period"] > 15).all()
    blow = table["displacement per blow"]
    assert mi.resolution(table) == blow[0]
    assert abs(blow[1] / 20e-9 - 1) < 0.01
    bounce = table["displacement per impact"]
    np.testing.assert_allclose(bounce * table["impacts per period"], blow, rtol=1e-12)


def test_no_resolution_says_why():
    drive = mi.Sine(amplitude=0.24, omega=0.5)
    table = mi.speed_over_voltage(PAPER, drive, [0.1, 0.12], transient=50, periods=10)
    with pytest.raises(mi.InvalidParameter, match="one blow in a period, but 0 to 0; add voltages"):
        mi.resolution(table)
    backward = table.assign(**{"blows per period": 1.0, "displacement per blow": -1e-4})
    with pytest.raises(mi.InvalidParameter, match="forward at none of the 2 voltages with one"):
        mi.resolution(backward)
    failed = table.assign(**{"blows per period": math.nan})
    with pytest.raises(mi.InvalidParameter, match="one blow in a period; add voltages"):
        mi.resolution(failed)
    with pytest.raises(mi.InvalidParameter, match="not a table of speed_over_voltage"):
        mi.resolution(table.drop(columns="displacement per blow"))


@pytest.mark.slow
def test_period_one_window_of_type_two():
    drive = mi.Sine(amplitude=0.18, omega=0.485)
    window = mi.period_one_window(PAPER, drive, low=0.16, high=0.19)
    assert (window.low_kind, window.high_kind) == ("period-doubling", "bound")
    assert abs(window.low - 0.176318773) < 1e-8
    assert window.high == 0.19
    assert math.isclose(window.margin, (0.19 - window.low) / (0.19 + window.low))
    with pytest.raises(mi.InvalidParameter, match="amplitude"):
        mi.period_one_window(PAPER, drive, low=0.19, high=0.2)


def test_preset_does_what_was_measured():
    run = mi.simulate(MITA, mi.Sine(amplitude=100.0, omega=2 * math.pi), 8, window=(2, 8))
    found = mi.blows(run)
    assert abs(found.displacement_per_blow / 20e-9 - 1) < 0.01
    assert found.per_period == 1.0  # two in a cycle of the voltage, which is two forcing periods
    assert run.statistics["chatter sequences"] == found.count
    assert (run.impacts["stopper"] == "right").all()
    assert run.statistics["share resting"] > 0.5


def test_the_step_of_a_slow_device_grows_with_the_rate_of_the_voltage():
    def step(volts, hertz):
        run = mi.simulate(MITA, mi.Sine(amplitude=volts, omega=2 * math.pi * hertz), 4,
                          window=(2, 4))  # fmt: skip
        return mi.blows(run).displacement_per_blow

    assert step(31.0, 1) == 0.0  # pull-in is at 31.6 V
    assert step(33.0, 1) < step(60.0, 1) < step(100.0, 1) < step(150.0, 1)
    assert step(100.0, 0.1) < 0.6 * step(100.0, 1)


def test_blows_without_rest_are_impacts():
    run = mi.simulate(PAPER, mi.Sine(amplitude=0.24, omega=0.5), 100, window=(50, 100))
    found = mi.blows(run)
    assert found.count == 50
    assert found.displacement_std < 1e-12
    assert found.displacement_per_blow == run.statistics["displacement per impact"]
    quiet = mi.blows(mi.simulate(PAPER, mi.Sine(amplitude=0.1, omega=0.5), 10))
    assert (quiet.count, quiet.displacement_per_blow) == (0, 0.0)
    assert math.isnan(quiet.displacement_std)
