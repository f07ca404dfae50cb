"""Corners and jumps of transitions that a branch crosses, as by an ``if`` in a function."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.orbits.periodic_orbit import PeriodicOrbit

DIFFERENCE_STEP = 1e-3  # of one-sided slopes, relative to the interval
MIN_BEND = 1e-3  # least change of the slope at a corner, relative to the slope
HALVINGS = 12  # of an interval, after which the bend of a smooth function is below a thousandth
ROUNDING = 64.0 * np.finfo(float).eps  # error of a state, relative to it
REMAINDER = 0.5  # of the change, at a corner; for a smooth function almost nothing remains
STEPS_BEYOND = 5  # of the branch, whose length is searched beyond its end


class Corner(NamedTuple):
    """A point at which a transition on a branch is not smooth."""

    mode: int  # before the transition
    code: int  # of the transition
    value: float  # of the parameter
    y: Floats  # the state before the transition


def corners(orbits: Sequence[PeriodicOrbit], parameter: str) -> Iterator[Corner]:
    """Yield the corners between successive orbits of a branch, and just beyond its end."""
    for one, other in pairwise(orbits):
        yield from _between(one, other, parameter, 0.0, 1.0)
    if len(orbits) > 1:
        before = orbits[-1 - min(STEPS_BEYOND, len(orbits) - 1)]
        # From before the end, which may be nearer to a corner than a difference.
        yield from _between(before, orbits[-1], parameter, 0.5, 2.0)


def _between(
    one: PeriodicOrbit, other: PeriodicOrbit, parameter: str, first: float, last: float
) -> Iterator[Corner]:
    """Yield the corners of transitions at states from part `first` to `last` of a chord."""
    if [s.code for s in one.segments] != [s.code for s in other.segments]:
        return
    automaton = one.shooting.automaton
    ends = [
        [
            np.concatenate([[orbit.family.values[parameter], orbit.point.ends[i]], arc.end,
                            orbit.point.parameter_point.parameters])
            for i, arc in enumerate(orbit.point.arcs)
        ]
        for orbit in (one, other)
    ]  # fmt: skip
    n = len(automaton.states)
    for segment, start, end in zip(one.segments, *ends, strict=True):
        if segment.code < 0 or np.array_equal(start, end):
            continue

        def after(s: float, a: Floats = start, b: Floats = end, code: int = segment.code,
                  mode: int = segment.mode) -> Floats:  # fmt: skip
            numbers = a + s * (b - a)
            return automaton.state_after(mode, code, numbers[1], numbers[2 : 2 + n],
                                         numbers[2 + n :])[1]  # fmt: skip

        s = _corner(after, first, last)
        if s is not None:
            numbers = start + s * (end - start)
            yield Corner(segment.mode, segment.code, float(numbers[0]), numbers[2 : 2 + n])


def _corner(function: Callable[[float], Floats], first: float, last: float) -> float | None:
    """Return where a function bends or jumps in an interval; None if nowhere."""
    try:
        bends, slopes = _bends(function, first, last)
        component = int(np.argmax(bends))
        bend = total = bends[component]
        for _ in range(HALVINGS):
            if not bend > max(REMAINDER * total, MIN_BEND * slopes[component]):
                return None
            middle = 0.5 * (first + last)
            left = _bends(function, first, middle)[0][component]
            right = _bends(function, middle, last)[0][component]
            first, last = (first, middle) if left > right else (middle, last)
            bend = max(left, right)
    except (ArithmeticError, ValueError):
        return None
    return 0.5 * (first + last)


def _bends(function: Callable[[float], Floats], first: float, last: float) -> tuple[Floats, Floats]:
    """Return the change of the slope within an interval by component, and the largest slope.

    At a jump the chord is steeper than both ends. Rounding errors of states do not count.
    """
    length, h = last - first, DIFFERENCE_STEP * (last - first)
    start, end = function(first), function(last)
    chord, (before, after) = (
        (end - start) / length,
        ((function(first + h) - start) / h, (end - function(last - h)) / h),
    )
    bends = np.maximum(np.abs(after - before), np.abs(chord - 0.5 * (before + after)))
    noise = ROUNDING * np.maximum(np.abs(start), np.abs(end)) / h
    return np.maximum(bends - noise, 0.0), np.abs([before, chord, after]).max(axis=0)
