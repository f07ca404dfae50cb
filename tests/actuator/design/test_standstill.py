"""Runs that end when the device stands still."""

import pytest

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
OPTIONS = mi.Options(method="dop853", engine="interpreted")


def until_still(actuator, drive=DRIVE, **given):
    return mi.simulate(
        actuator, drive, initial=mi.kicked_state(actuator), until="still", options=OPTIONS, **given
    )


@pytest.mark.nightly
def test_a_spring_brings_the_walk_to_rest():
    # With one coefficient of friction the frame slips back by as much as it walks.
    run = until_still(ZHAO.replace(mu_s=0.27).adding(mi.FrameSpring(k1=2e4)))
    assert run.ended == "still"
    grid = run.samples(1)["x1"]
    assert abs(grid - grid.iloc[-1])[-12:].max() < 1e-6 * ZHAO.delta
    # There the spring pulls by less than friction holds, and by more than half of that.
    assert 0.5 < 2e4 * run.final.x1 / (0.27 * 6.0 * 9.81) < 1.0
    # It is the run of that length, bit for bit, and its end lies on an orbit that closes in x1.
    again = mi.simulate(run.system, run.periods, initial=mi.kicked_state(ZHAO), options=OPTIONS)
    assert again.final == run.final
    orbit = mi.find_orbit(run, periods=1, options=OPTIONS)
    assert orbit.step == 0.0
    assert orbit.state.x1 == pytest.approx(run.final.x1, rel=1e-4)


@pytest.mark.nightly
def test_a_frame_that_slips_back_at_intervals_does_not_stand_still():
    # mu_s > mu_d: four steps forward, then all of them back at once.
    run = until_still(ZHAO.adding(mi.FrameSpring(k1=2e4)), periods=100)
    assert run.ended == "time"
    assert run.periods == 100
    x1 = run.samples(1)["x1"].to_numpy()[-20:]
    assert x1.max() > 2.0 * x1.min() > 0.0


def test_a_device_that_walks_on_does_not_stand_still():
    run = until_still(ZHAO, periods=26)
    assert (run.ended, run.periods) == ("time", 26)


def test_a_device_without_impacts_stands_still_once_its_swing_is_steady():
    damped = ZHAO.replace(c=0.4)
    run = mi.simulate(damped, mi.Sine(amplitude=0.05, omega=0.5), until="still", options=OPTIONS)
    assert run.ended == "still"
    # A swing that dies as exp(-0.2 t) is within 1e-6 after some 11 periods; 24 are looked at.
    assert 24 <= run.periods < 45


def test_what_is_refused():
    with pytest.raises(mi.InvalidParameter, match="or 'still'"):
        mi.simulate(ZHAO, DRIVE, until="stil")
    ball = mi.System(states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -y.x))
    with pytest.raises(mi.InvalidParameter, match="for actuators only"):
        mi.simulate(ball, until="still")
