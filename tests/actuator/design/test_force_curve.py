"""Mean speed over a load: what friction holds, by hand, and where the walk ends."""

import math

import numpy as np
import pytest

import mems_impact as mi
from tests.actuator.slipping import PULLED, SLIPPING

ZHAO = mi.load_actuator("zhao2004")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
OPTIONS = mi.Options(method="dop853", engine="interpreted")
WEIGHT = 6.0 * 9.81


@pytest.fixture(scope="module")
def curve():
    return mi.force_curve(ZHAO, DRIVE, [23.4, 8.0, 0.0], transient=20, periods=10, options=OPTIONS)


@pytest.mark.slow
def test_what_friction_holds_by_hand():
    tilted = ZHAO.adding(mi.Tilt(angle=0.1))
    quiet = mi.Sine(amplitude=0.0, omega=0.5)
    held = mi.force_curve(tilted, quiet, 0.0, initial=mi.State(), transient=0, periods=1,
                         options=OPTIONS)  # fmt: skip
    normal, weight = WEIGHT * math.cos(0.1), WEIGHT * math.sin(0.1)
    assert held.holding_force == pytest.approx(0.4 * normal - weight, rel=1e-12)
    assert held.sliding_force == pytest.approx(0.27 * normal - weight, rel=1e-12)
    assert held.table["does"].tolist() == ["stands"]
    assert math.isnan(held.stall_force)


@pytest.mark.nightly
def test_it_walks_until_the_frame_is_torn_off(curve):
    assert curve.holding_force == pytest.approx(0.4 * WEIGHT, rel=1e-12)
    assert curve.sliding_force == pytest.approx(0.27 * WEIGHT, rel=1e-12)
    table = curve.table
    assert table["load"].tolist() == [0.0, 8.0, 23.4]
    assert table["does"].tolist() == ["walks", "walks", "runs away"]
    assert (table["mean speed error"][:2] < 1e-3 * table["mean speed"][:2]).all()
    assert math.isnan(table["mean speed"].iloc[-1])
    np.testing.assert_allclose(table["power"], table["load"] * table["mean speed"])


@pytest.mark.nightly
def test_the_walk_ends_where_the_load_and_the_block_reach_static_friction(curve):
    # By a run: from the orbit just below it goes on, just above the frame breaks away.
    below, above = (curve.stall_force * factor for factor in (1.0 - 1e-3, 1.0 + 1e-3))
    loaded = ZHAO.adding(mi.FrameForce(force=below))
    orbit = mi.find_orbit(loaded, DRIVE, guess=mi.find_orbit(
        ZHAO.adding(mi.FrameForce(force=8.0)), DRIVE, guess=mi.kicked_state(ZHAO), periods=1,
        transient=20, options=OPTIONS).state, periods=1, options=OPTIONS)  # fmt: skip
    assert orbit.stable
    assert orbit.admissible
    # What the block exerts on the frame at rest, with the load, from samples.
    grid = orbit.samples(4000)
    x2, v2, stuck = grid["x2"], grid["v2"], grid["mode"].astype(str).str.startswith("stuck")
    volts = DRIVE.amplitude * np.cos(DRIVE.omega * grid["t"])
    push = ZHAO.k * x2 + ZHAO.c * v2 - ZHAO.alpha * volts**2 / (ZHAO.d - x2) ** 2 - below
    assert np.abs(push[stuck]).max() == pytest.approx(0.4 * WEIGHT, rel=1e-3)
    beyond = mi.simulate(
        ZHAO.adding(mi.FrameForce(force=above)), DRIVE, 4, initial=orbit.state, options=OPTIONS
    )
    assert beyond.final.v1 < -10.0


@pytest.mark.nightly
def test_a_frame_that_always_slips_is_not_running_away():
    # Beyond the friction on a frame that slips, 2.47 uN, nothing ends a slip; below, all do.
    loads = [-2.6e-6, 0.0, 0.5e-6, 2.6e-6, 3e-6]
    curve = mi.force_curve(SLIPPING, PULLED, loads, transient=20, periods=5, options=OPTIONS)
    does = ["runs away", "walks", "walks back", "runs away", "runs away"]
    assert curve.table["does"].tolist() == does
    assert curve.sliding_force == pytest.approx(0.24 * 1.05e-6 * 9.81, rel=1e-12)
    assert 0.0 < curve.stall_force < 0.5e-6
    # Plain runs walk just below the stall force, and back just above.
    for part, sign in ((0.99, 1.0), (1.01, -1.0)):
        loaded = SLIPPING.adding(mi.FrameForce(force=part * curve.stall_force))
        run = mi.simulate(loaded, PULLED, 300, window=(200, 300), options=OPTIONS)
        assert sign * run.statistics["mean speed"] > 0.0
    # The speed is that of a run of the device without load, in which the frame never rests.
    run = mi.simulate(SLIPPING, PULLED, 60, window=(50, 60), options=OPTIONS)
    assert run.statistics["share slipping"] > 0.99
    assert curve.table["mean speed"].iloc[1] == pytest.approx(
        run.statistics["mean speed"], rel=1e-5
    )


@pytest.mark.nightly
def test_friction_that_rises_with_the_speed_holds_in_the_end():
    # 0.3 at rest, 0.24 once the frame slips, and 1 s/m more: 3 uN are held at a slow slip back.
    rising = SLIPPING.adding(mi.StribeckFriction(speed=1e-4, viscous=10.0))
    curve = mi.force_curve(rising, PULLED, [3.2e-6], initial=mi.State(v1=-0.01), options=OPTIONS)
    assert curve.table["does"].tolist() == ["walks back"]
    falling = SLIPPING.adding(mi.StribeckFriction(speed=1e-4))
    curve = mi.force_curve(falling, PULLED, [3.2e-6], transient=5, periods=5,
                          initial=mi.State(v1=-0.01), options=OPTIONS)  # fmt: skip
    assert curve.table["does"].tolist() == ["runs away"]
    assert curve.sliding_force == pytest.approx(0.24 * 1.05e-6 * 9.81, rel=1e-9)
    spring = SLIPPING.adding(mi.FrameSpring(k1=1e-4))
    curve = mi.force_curve(spring, PULLED, [3.2e-6], transient=0, periods=2,
                          initial=mi.State(v1=-0.01), options=OPTIONS)  # fmt: skip
    assert curve.table["does"].tolist() != ["runs away"]


@pytest.mark.slow
def test_loads_by_default_end_beyond_the_stall_force():
    curve = mi.force_curve(ZHAO, DRIVE, transient=20, periods=6)
    table = curve.table
    assert table["load"].iloc[0] == 0.0
    assert table["load"].iloc[-1] == pytest.approx(1.1 * curve.stall_force)
    assert set(table["does"][:-1]) == {"walks"}
    assert table["does"].iloc[-1] == "runs away"
    assert curve.stall_force < curve.holding_force


def test_an_interruption_keeps_the_finished_loads():
    def interrupt(finished):
        if finished == 2:
            raise KeyboardInterrupt

    with pytest.raises(mi.Interrupted, match="after 2 of 3 loads") as caught:
        mi.force_curve(ZHAO, DRIVE, [0.0, 5.0, 10.0], transient=20, periods=2, progress=interrupt)
    assert caught.value.partial["load"].tolist() == [0.0, 5.0]


def test_what_it_does_not_take():
    with pytest.raises(mi.InvalidParameter, match="finite numbers"):
        mi.force_curve(ZHAO, DRIVE, [0.0, math.inf])
    with pytest.raises(mi.InvalidParameter, match="Actuator"):
        mi.force_curve("zhao2004", DRIVE, [0.0])
