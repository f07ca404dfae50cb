"""Studies warn once of starts beyond a guard, and of jumps of the flow."""

from __future__ import annotations

import math
import warnings
from concurrent.futures import ProcessPoolExecutor

import pytest

import mems_impact as mi

RECURRENCE = mi.RecurrenceOptions(transient=20, periods=5, exponents="none")


def swings(mode, t, y, p):
    push = p.push if y.x > 0.6 else 0.0
    return y.v, -y.x - 0.5 * y.v + math.cos(t) + push


def above(mode, t, y, p):
    return y.x + p.depth


def rebound(mode, t, y, p):
    return mode, (-p.depth, -0.5 * y.v)


SWING = mi.System(
    states=("x", "v"),
    flow=swings,
    period=2.0 * math.pi,
    parameters={"push": 0.0, "depth": 10.0},
    guards=[mi.Guard("floor", above, rebound)],
    initial={"x": 0.5},
)
"""Its motion never comes to the floor from above."""


def caught_by(kind, call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    assert {w.filename for w in caught if w.category is kind} <= {__file__}
    return [str(w.message) for w in caught if w.category is kind]


def basins(executor=None):
    return mi.basins(
        SWING, x=("x", [-12.0, -11.0, 0.0, 1.0]), recurrence=RECURRENCE, executor=executor
    )


@pytest.mark.slow
@pytest.mark.parametrize("executor", [None, lambda: ProcessPoolExecutor(1)])
def test_a_grid_on_both_sides_of_a_guard_is_reported_once_with_its_share(executor):
    (told,) = caught_by(mi.StartWarning, lambda: basins(executor))
    assert told.startswith("basins (2 of 4 points, first x = -12): the margin of 'floor' is neg")
    assert "changes x from -12 to -10" in told


def test_a_map_names_parameters_whose_start_lies_beyond_a_guard():
    def over(depths):
        mi.operating_map(SWING, x=("depth", depths), y=("push", [0.0]), recurrence=RECURRENCE)

    (told,) = caught_by(mi.StartWarning, lambda: over([-1.0, 5.0, 10.0]))
    assert told.startswith("operating_map (1 of 3 points, depth = -1, push = 0): the margin")
    assert caught_by(mi.StartWarning, lambda: over([5.0, 10.0])) == []


def test_a_sweep_names_once_the_values_that_begin_beyond_a_guard():
    def over(depths):
        mi.sweep(SWING, "depth", depths, transient=5, periods=5, direction="up")

    (told,) = caught_by(mi.StartWarning, lambda: over([-1.0, 5.0]))
    assert told.startswith("sweep (1 of 2 points, depth = -1): the margin of 'floor'")
    assert caught_by(mi.StartWarning, lambda: over([5.0, 10.0])) == []


@pytest.mark.slow
@pytest.mark.parametrize("verb", [mi.find_orbit, mi.lyapunov])
def test_orbits_and_exponents_tell_of_a_guess_beyond(verb):
    start = "guess" if verb is mi.find_orbit else "initial"
    # An orbit takes less time interpreted than its derivatives take to compile.
    engine = "interpreted" if verb is mi.find_orbit else "auto"
    options = mi.Options(method="dop853", engine=engine)
    told = caught_by(mi.StartWarning, lambda: verb(SWING, **{start: {"x": -12.0}}, options=options))
    assert len(told) == 1
    assert (
        caught_by(mi.StartWarning, lambda: verb(SWING, **{start: {"x": 1.0}}, options=options))
        == []
    )


@pytest.mark.parametrize("executor", [None, lambda: ProcessPoolExecutor(1)])
def test_a_jump_at_some_points_is_reported_once(executor):
    def over(pushes):
        mi.operating_map(
            SWING, x=("push", pushes), y=("depth", [10.0]), recurrence=RECURRENCE, executor=executor
        )

    (told,) = caught_by(mi.DiscontinuityWarning, lambda: over([0.0, 0.5, 1.0]))
    assert "operating_map (push = 0.5, depth = 10): the flow is discontinuous: dv/dt jumps" in told
    assert "at x = 0.6, where no step is accurate" in told
    assert caught_by(mi.DiscontinuityWarning, lambda: over([0.0])) == []


def test_a_sweep_warns_of_a_jump_once():
    def over():
        mi.sweep(SWING, "push", [0.0, 0.5, 1.0], transient=5, periods=5)

    (told,) = caught_by(mi.DiscontinuityWarning, over)
    assert told.startswith("sweep (push = 0.5): the flow is discontinuous")


def test_a_map_warns_once_of_waveforms_of_constant_force():
    device, drive = mi.load_actuator("zhao2004"), mi.Square(amplitude=0.2, omega=0.5)

    def over(lows):
        system = device.under(drive)
        mi.operating_map(system, x=("low", lows), y=("e", [0.5, 0.6]), recurrence=RECURRENCE)

    (warning,) = caught_by(UserWarning, lambda: over([0.0, -0.2]))
    assert warning.startswith("operating_map (low = -0.2, e = 0.5): the force of this square wave")
    assert caught_by(UserWarning, lambda: over([0.0, -0.1])) == []
