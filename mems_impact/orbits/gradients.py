"""Derivatives of what an orbit's margins do, by its unknowns and the active parameters.

All are shape (unknowns + k,), and follow from the columns that a `Point` has already.
"""

from __future__ import annotations

import numpy as np

from mems_impact.errors import OrbitError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.shooting import Point, Shooting


def length_gradient(shooting: Shooting, point: Point, i: int) -> Floats:
    """Return the derivatives of the length of segment `i`."""
    layout, times = shooting.layout, shooting.unpack(point.unknowns)[1]
    _, _, start_rates, end_rates = layout.instants(point.setting, times)
    by_unknown = layout.by_end[i] - layout.by_start[i]
    return np.append(by_unknown, end_rates[i] - start_rates[i])


def rate_gradient(shooting: Shooting, point: Point, i: int, guard: int) -> Floats:
    """Return the derivatives of the rate of `guard` at the event that ends segment `i`."""
    event, k = point.events[i], len(shooting.active)
    if event is None or i not in shooting.events:
        raise OrbitError(f"segment {i} ends with no guard", "take another point")
    row = shooting.m + guard  # the rates stand behind the margins
    by_end = event.margin_by_state[row]
    by_unknown = by_end @ point.end_by_unknown[i]
    by_unknown = by_unknown + float(event.margin_by_time[row]) * shooting.layout.by_end[i]
    by_parameter = event.margin_by_parameter[row, :k] * point.setting.scales
    return np.append(by_unknown, by_end @ point.end_by_parameter[i] + by_parameter)


def touch_gradient(shooting: Shooting, point: Point, i: int, guard: int) -> Floats:
    """Return the derivatives of the smallest margin at a closest approach inside segment `i`.

    There the margin stands still, so that the instant's own motion is no matter.
    """
    setting, layout, k = point.setting, shooting.layout, len(shooting.active)
    arc, mode = point.arcs[i], shooting.segments[i].mode
    y, columns = arc.touches[guard, 0], arc.touches[guard, 1:]
    time = float(arc.minima_time[guard])
    event = shooting.variational(setting).event(mode, guard, time, y, setting.room(time))
    by_column = columns @ event.margin_by_state[guard]
    f = len(shooting.free)
    by_state, by_parameter = by_column[:f], by_column[f : f + k]
    # The columns of the parameters are carried at instants that move with them.
    moved = setting.motion(point.starts[i], point.ends[i])[:k] @ np.array([1.0, time])
    by_parameter = by_parameter + float(event.margin_by_time[guard]) * moved
    by_parameter = (by_parameter + event.margin_by_parameter[guard, :k]) * setting.scales
    by_start = -float(by_state @ arc.slope_start[shooting.free])
    _, _, start_rates, _ = layout.instants(setting, shooting.unpack(point.unknowns)[1])
    by_unknown = by_start * layout.by_start[i]
    by_unknown[f * i : f * (i + 1)] += by_state
    return np.append(by_unknown, by_parameter + by_start * start_rates[i])
