"""Vector fields of the variational equations.

All derivatives of an automaton's functions are directional, by central differences of sixth order
with the automaton's step along a direction of length one. With a step of 1e-3, and states and
parameters of order one, truncation and rounding errors are both near 1e-13, so that an automaton
needs no Jacobian.

A *column* is a perturbation: one for each component of the initial state that is not cyclic, then
one for each direction in the space of parameters.

Lyapunov exponents need far fewer digits than Newton's method, over many more periods: their columns
use differences of second order, with a third of the calls.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from mems_impact._util.arrays import Floats
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.differences import weight_of
from mems_impact.hybrid.problem import Problem


def with_columns(
    problem: Problem, flow: Callable[..., Any], parameters: Floats, size: int
) -> Problem:
    """Return the problem of `size` components, state and columns, with their flow."""
    automaton = problem.automaton
    extended = Automaton(
        states=tuple(f"y{i}" for i in range(size)),
        modes=automaton.modes,
        guards=automaton.guards,
        flow=flow,
        margins=automaton.margins,
        transition=automaton.transition,
        step=automaton.step,
        bounds=automaton.bounds,
    )
    return Problem(
        automaton=extended,
        parameters=parameters,
        period=problem.period,
        options=problem.options,
        time_scale=problem.time_scale,
    )


@cache
def extended_flow(
    flow: Callable[..., Any], n: int, free: int, count: int, step: float
) -> Callable[..., Any]:
    """Return the flow of the state and its columns.

    The extended state is y (n), then `free` + k columns of length n. The extended parameters are
    p (count), k directions in the space of p, for each direction the motion of time (two numbers,
    see `mems_impact.hybrid.variational.derivatives`), and scratch of 2 n + count. The number k is
    that of the state, so that numba types the function once for all k.
    """

    def extended(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        columns = len(y) // n - 1
        directions = columns - free
        motion = count * (1 + directions)
        scratch = motion + 2 * directions
        y_shifted = p[scratch : scratch + n]
        slope = p[scratch + n : scratch + 2 * n]
        p_shifted = p[scratch + 2 * n : scratch + 2 * n + count]
        for c in range(columns):
            column = n * (1 + c)
            length = 0.0
            for i in range(n):
                length = max(length, abs(y[column + i]))
            direction = count * (1 + c - free)
            time_rate, time_stretch = 0.0, 0.0
            if c >= free:
                time_stretch = p[motion + 2 * (c - free) + 1]
                time_rate = p[motion + 2 * (c - free)] + time_stretch * t
                for i in range(count):
                    length = max(length, abs(p[direction + i]))
            for i in range(n):
                dy[column + i] = 0.0
            for i in range(count):
                p_shifted[i] = p[i]
            if length > 0.0:
                for s in range(-3, 4):
                    if s != 0:
                        h = s * step / length
                        weight = length * weight_of(s) / step
                        for i in range(n):
                            y_shifted[i] = y[i] + h * y[column + i]
                        if c >= free:
                            for i in range(count):
                                p_shifted[i] = p[i] + h * p[direction + i]
                        flow(mode, t + h * time_rate, y_shifted, p_shifted, slope)
                        for i in range(n):
                            dy[column + i] += weight * slope[i]
        for i in range(count):
            p_shifted[i] = p[i]
        for i in range(n):
            y_shifted[i] = y[i]
        flow(mode, t, y_shifted, p_shifted, slope)
        for i in range(n):
            dy[i] = slope[i]
        for c in range(free, columns):
            for i in range(n):
                dy[n * (1 + c) + i] += p[motion + 2 * (c - free) + 1] * slope[i]

    return extended


STEP_RATIO = 1.0 / 128.0  # of the automaton's step; balances rounding and second-order truncation


@cache
def stretched_flow(flow: Callable[..., Any], n: int, count: int, step: float) -> Callable[..., Any]:
    """Return the flow of the state and its perturbations, for Lyapunov exponents.

    The extended state is y (n), then any number of columns. The extended parameters are p (count),
    then scratch of 2 n.
    """
    width = STEP_RATIO * step

    def stretched(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        y_shifted = p[count : count + n]
        slope = p[count + n : count + 2 * n]
        for c in range(len(y) // n - 1):
            column = n * (1 + c)
            length = 0.0
            for i in range(n):
                length = max(length, abs(y[column + i]))
                dy[column + i] = 0.0
            if length > 0.0:
                h = width / length
                for i in range(n):
                    y_shifted[i] = y[i] + h * y[column + i]
                flow(mode, t, y_shifted, p, slope)
                for i in range(n):
                    dy[column + i] = slope[i]
                    y_shifted[i] = y[i] - h * y[column + i]
                flow(mode, t, y_shifted, p, slope)
                for i in range(n):
                    dy[column + i] = (dy[column + i] - slope[i]) / (2.0 * h)
        for i in range(n):
            y_shifted[i] = y[i]
        flow(mode, t, y_shifted, p, slope)
        for i in range(n):
            dy[i] = slope[i]

    return stretched
