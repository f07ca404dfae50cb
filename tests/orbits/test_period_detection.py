"""Detection of the period of a motion."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.orbits.period_detection import detect_forcing_periods, first_return
from tests.hybrid.systems import STOP, TAU, at, problem, stop

PLAIN = mi.Options(engine="interpreted", method="dop853")


@pytest.mark.parametrize(("count", "period"), [(3, 0), (4, 1), (5, 1), (6, 0), (7, 2), (9, 2)])
def test_three_returns_are_seen_before_a_motion_counts_as_settled(count, period):
    """Of a motion with one or two states in turn: three times so many, and where it began."""
    states = np.zeros((count, 1)) if count in (3, 4, 5) else np.arange(count)[:, None] % 2.0
    modes = np.zeros(count, dtype=np.int64)
    assert first_return(states, modes, np.ones(1), from_last=True) == period


@pytest.mark.parametrize(("periods", "seen"), [(1, 1), (7, 7), (16, 16), (17, 0)])
def test_a_motion_is_recognized_after_up_to_sixteen_forcing_periods(periods, seen):
    """A harmonic oscillator whose own period is so many of those: from its first and last state."""
    setup = problem(STOP, stop(d=2.0), period=TAU / periods, rtol=1e-9)
    recognized = detect_forcing_periods(setup, at([1.0, 0.0]))
    assert recognized.start_periods == seen
    assert recognized.end_periods in (seen, 0)  # one that returns at once is looked at no further
    if periods > 1:
        assert recognized.end_periods == seen


def test_a_small_subharmonic_is_no_motion_of_one_period():
    """The map x -> 1 + f(x - 1) with f(u) = -1.04 u + b u^3 moves from u to -u if b u^2 = 0.04."""
    apart = 2e-6

    def jump(mode, t, y, p):
        u = (y.x - 1.0) / apart
        return mode, (1.0 + apart * (0.04 * u**3 - 1.04 * u),)

    system = mi.System(
        states=("x",), flow=lambda mode, t, y, p: (0.0,), switch_transition=jump, switches=(0.5,),
        period=1.0, initial={"x": 1.0 + apart},
    )  # fmt: skip
    orbit = mi.find_orbit(system, options=PLAIN)
    assert orbit.periods == 2
    assert abs(orbit.state.x - 1.0) == pytest.approx(apart, rel=1e-6)


def pulsating(mode, t, y, p):
    """Leave 0 towards 1 at rates from 0.5 to 1.5."""
    return (y.x * (1.0 - y.x * y.x) * (1.0 + 0.5 * math.cos(2.0 * math.pi * t)),)


def rotating(mode, t, y, p):
    """Leave the circle of radius 1 towards the circle of radius 2."""
    square = y.x * y.x + y.y * y.y
    rate = 0.2 * (square - 1.0) * (4.0 - square)
    return rate * y.x - 2.0 * y.y, rate * y.y + 2.0 * y.x


FORCED = mi.System(states=("x",), flow=pulsating, period=1.0, initial={"x": 1e-9})
CYCLE = mi.System(states=("x", "y"), flow=rotating, initial={"x": 1.0 + 1e-9, "y": 0.0})


@pytest.mark.parametrize(
    ("system", "transient", "radius"),
    [(FORCED, 0.0, 0.0), (FORCED, 30.0, 1.0), (CYCLE, 0.0, 1.0), (CYCLE, 30.0, 2.0)],
)
def test_a_transient_is_run_before_the_search(system, transient, radius):
    """The motion from beside an unstable orbit returns at once, and leaves it later."""
    orbit = mi.find_orbit(system, transient=transient, options=PLAIN)
    assert math.hypot(*orbit.state.as_dict().values()) == pytest.approx(radius, abs=1e-8)
    assert orbit.stable == (transient > 0.0)
