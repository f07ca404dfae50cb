"""Working points over a parameter, against plain long runs and their energy balances."""

import math
from dataclasses import replace

import numpy as np
import pytest

import mems_impact as mi
from tests.actuator.slipping import PULLED, SLIPPING

PAPER, MITA = mi.load_actuator("zhao2004"), mi.load_actuator("mita2003")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
BRIEF = {"transient": 200, "periods": 10}
WEAR = {"wear": 1e-13, "area": 1e-8, "depth": 1e-7}


@pytest.fixture(scope="module")
def curve():
    return mi.characteristic(PAPER, DRIVE, "amplitude", [0.16, 0.18, 0.24], stall=True, **BRIEF)


@pytest.mark.slow
def test_working_points_are_those_of_plain_long_runs(curve):
    table = curve.table
    assert table["amplitude"].tolist() == [0.16, 0.18, 0.24, 0.24, 0.18, 0.16]
    assert table["direction"].tolist() == ["up"] * 3 + ["down"] * 3
    assert table["impacting"].tolist() == [False, False, True, True, True, False]
    for row in table[table["impacting"]].to_dict("records"):
        drive = DRIVE.replace(amplitude=row["amplitude"])
        start = mi.simulate(PAPER, DRIVE, 600, initial=mi.kicked_state(PAPER)).final
        begun = mi.simulate(PAPER, drive, 600, initial=start)
        run = mi.simulate(PAPER, drive, 10, initial=begun.final, window=(0, 10))
        moved = run.final.x1 - begun.final.x1
        assert row["displacement per period"] == pytest.approx(moved / 10, rel=1e-6)
        assert row["mean speed"] == pytest.approx(moved / 10 / drive.period, rel=1e-6)
        assert row["mean speed error"] < 1e-3 * row["mean speed"]
        balance = mi.energy(run)  # its arcs are integrated again
        assert row["energy in per period"] == pytest.approx(balance.input / 10, rel=1e-6)
        assert row["energy in per blow"] == pytest.approx(balance.input / 10, rel=1e-6)
        assert row["power in"] == pytest.approx(balance.input / 10 / drive.period, rel=1e-6)
        assert row["slip per period"] == pytest.approx(balance.slip_path / 10, rel=1e-6)
        assert row["deflection"] == PAPER.delta
    still = table.iloc[0]
    assert (still["displacement per period"], still["slip per period"]) == (0.0, 0.0)
    assert math.isnan(still["displacement per blow"])
    assert math.isnan(still["stall force"])


@pytest.mark.slow
def test_a_frame_walks_against_less_than_its_stall_force(curve):
    stall = curve.table["stall force"].iloc[2]
    state = mi.kicked_state(PAPER)
    for part in (0.0, 0.5, 0.9, 0.99):  # a kick would tear the frame off
        loaded = PAPER.adding(mi.FrameForce(force=part * stall))
        run = mi.simulate(loaded, DRIVE, 60, initial=state)
        assert run.statistics["mean speed"] > 0.0
        state = run.final
    loaded = PAPER.adding(mi.FrameForce(force=1.01 * stall))
    assert mi.simulate(loaded, DRIVE, 60, initial=state).final.v1 < -1.0


def test_the_finest_step_and_the_values_with_impacts(curve, tmp_path):
    table = curve.table
    assert curve.resolution() == table["displacement per blow"][4]
    assert 0.0 < curve.resolution() < table["displacement per blow"][3]
    onset = curve.impact_onset
    assert onset[["direction", "amplitude from", "amplitude to"]].values.tolist() == [
        ["up", 0.24, 0.24], ["down", 0.18, 0.24]]  # fmt: skip
    assert repr(curve) == "Characteristic(amplitude = 0.16 to 0.24, 3 values)"
    curve.save(tmp_path / "curve.zip")
    assert mi.load(tmp_path / "curve.zip") == curve


@pytest.mark.slow
def test_no_finest_step_says_why(curve):
    table = curve.table[:2]
    with pytest.raises(mi.InvalidParameter, match="one blow in a period, but 0 to 0; add values"):
        replace(curve, table=table).resolution()
    backward = table.assign(**{"blows per period": 1.0, "displacement per blow": -1e-4})
    with pytest.raises(mi.InvalidParameter, match="forward at none of the 2 values with one"):
        replace(curve, table=backward).resolution()


def test_bounces_of_a_blow_and_its_wear():
    drive = mi.Sine(amplitude=100.0, frequency=1.0)
    found = mi.characteristic(
        MITA, drive, "amplitude", ["100 V"], direction="down", transient=2, periods=2, **WEAR
    )
    (row,) = found.table.to_dict("records")
    assert row["blows per period"] == 1.0
    assert row["impacts per period"] > 15
    assert abs(row["displacement per blow"] / 20e-9 - 1) < 0.01
    run = mi.simulate(MITA, drive, 4, window=(2, 4))
    worn = mi.life(run, **WEAR)
    assert row["life"] == pytest.approx(worn.time, rel=1e-6)
    assert row["distance"] == pytest.approx(worn.distance, rel=1e-6)
    assert found.table.attrs["units"]["life"] == "s"


@pytest.mark.slow
def test_curves_over_the_frequency():
    # A force alpha v^2/d^2 on a linear oscillator: its mean, and its swing at twice the frequency.
    found = mi.characteristic(
        PAPER, DRIVE, "omega", [0.3, 0.5], curves=("amplitude", [0.02, 0.24]), direction="down",
        transient=150, periods=2,
    )  # fmt: skip
    table = found.table
    assert table["amplitude"].tolist() == [0.02, 0.02, 0.24, 0.24]
    assert table["omega"].tolist() == [0.5, 0.3, 0.5, 0.3]
    assert table["impacting"].tolist() == [False, False, True, False]
    force, r = 0.5 * 0.02**2, 0.6
    linear = force * (1.0 + 1.0 / math.hypot(1.0 - r * r, PAPER.c * r))
    assert table["deflection"].iloc[1] == pytest.approx(linear, rel=0.01)
    onset = found.impact_onset
    assert np.isnan(onset["omega from"].iloc[0])
    assert onset["omega from"].iloc[1] == 0.5


@pytest.mark.slow
def test_a_block_that_rings_for_a_thousand_cycles_has_settled():
    device = mi.Actuator.from_design(
        frequency="10 kHz", quality=1000, proof_mass="4 ug", mass_ratio=7, gap="3 um",
        travel="1.8 um", electrode_area="0.07 mm^2", friction=(0.3, 0.2), restitution=0.6,
    )  # fmt: skip
    drive = mi.Sine(amplitude="4 V", frequency="5 kHz")
    (row,) = mi.characteristic(
        device, drive, "amplitude", [4.0], direction="up", transient=20, periods=20
    ).table.to_dict("records")
    # The transient lasts some 300 cycles; twice as many are discarded here.
    run = mi.simulate(device, drive, 3000, window=(2980, 3000))
    short = mi.simulate(device, drive, 40, window=(20, 40))
    late, early = (mi.energy(each).input / 20 for each in (run, short))
    assert abs(early / late - 1.0) > 0.1
    assert row["energy in per period"] == pytest.approx(late, rel=5e-3)
    approach = run.statistics["closest approach"]
    assert row["deflection"] == pytest.approx(device.delta - approach, rel=5e-3)


def test_an_interruption_keeps_the_finished_curve():
    def interrupt(finished):
        if finished == 3:
            raise KeyboardInterrupt

    with pytest.raises(mi.Interrupted) as caught:
        mi.characteristic(
            PAPER, DRIVE, "omega", [0.5, 0.51], curves=("amplitude", [0.1, 0.11]),
            direction="down", transient=150, periods=2, progress=interrupt,
        )  # fmt: skip
    partial = caught.value.partial
    assert set(partial["amplitude"][:2]) == {0.1}
    assert 2 <= len(partial) <= 3


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"parameter": "omga"}, "parameter = 'omga': must be one of amplitude, omega"),
        ({"curves": ("volts", [1.0])}, "curves = 'volts': must be one of amplitude"),
        ({"curves": 3}, "curves = 3: must be a name and its values"),
        ({"values": ["3 V"]}, "the device is dimensionless|system is dimensionless"),
        ({"wear": 1e-13}, "area: a life needs wear, area and depth"),
    ],
)
def test_what_it_does_not_take(given, message):
    arguments = {"parameter": "amplitude", "values": [0.2], **given}
    with pytest.raises(mi.InvalidParameter, match=message):
        mi.characteristic(PAPER, DRIVE, **arguments)


def test_a_clamped_frame_needs_a_normal_force_before_the_computation():
    heavy = SLIPPING.replace(mu_s=5.0, mu_d=4.0)
    with pytest.raises(mi.InvalidParameter, match="no normal force follows"):
        mi.characteristic(heavy, PULLED, "amplitude", [50.0], **WEAR)
