"""Vector fields of the variational equations, and derivatives of events.

A *column* is a perturbation: one for each component of the initial state that is not cyclic, then
one for each direction in the space of parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

from mems_impact._util.arrays import Floats
from mems_impact.errors import FunctionError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.problem import EngineBinding, Problem
from mems_impact.hybrid.variational.tangents import (
    Sizes,
    differences_reason,
    differentiated,
    note_refusal,
    width_for,
    with_code,
)


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
        bounds=automaton.bounds,
    )
    return Problem(
        automaton=extended,
        parameters=parameters,
        period=problem.period,
        options=problem.options,
        time_scale=problem.time_scale,
    )


def scratch_size(n: int, count: int, columns: int) -> int:
    """Return the number of extended parameters of `tangent_flow` that are scratch."""
    sizes = Sizes(n, count, n, width_for(columns))
    return 1 + math.ceil(columns / sizes.width) * sizes.memory


@cache
def tangent_flow(
    flow: Callable[..., Any],
    n: int,
    count: int,
    columns: int,
    directions: int = 0,
    *,
    exact: bool = True,
) -> Callable[..., Any]:
    """Return the flow of the state and its columns.

    The extended state is y (n), then columns of length n: perturbations of the state, then those of
    the parameters, one for each direction. The extended parameters are p (count), the directions in
    the space of p, and scratch (`scratch_size`), whose first value is to be zero after a change of
    the others.
    """
    sizes = Sizes(n, count, n, width_for(columns))
    width, record, length = sizes.width, sizes.record, sizes.memory
    of_parameters, of_slope = record * (1 + n), record * (1 + n + count)
    first_direction, scratch = columns - directions, count * (1 + directions)
    derive = differentiated(
        with_code(flow), flow, sizes, by_time=False, by_parameter=directions > 0, exact=exact
    )

    def fill(p):  # type: ignore[no-untyped-def]
        for first in range(0, columns, width):
            start = scratch + 1 + first // width * length
            for i in range(count):
                place = start + of_parameters + record * i
                p[place] = p[i]
                for k in range(width):
                    c = first + k
                    direction = count * (1 + c - first_direction) + i
                    p[place + 1 + k] = p[direction] if first_direction <= c < columns else 0.0
        p[scratch] = 1.0

    def extended(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        if p[scratch] == 0.0:
            fill(p)
        for first in range(0, columns, width):
            start = scratch + 1 + first // width * length
            p[start] = t
            for i in range(n):
                place = start + record * (1 + i)
                p[place] = y[i]
                for k in range(width):
                    c = first + k
                    p[place + 1 + k] = y[n * (1 + c) + i] if c < columns else 0.0
            derive(mode, 0, p, p, start)
            for i in range(n):
                place = start + of_slope + record * i
                dy[i] = p[place]
                for k in range(min(width, columns - first)):
                    dy[n * (1 + first + k) + i] = p[place + 1 + k]

    return extended


def table_size(n: int, m: int, count: int, directions: int) -> int:
    """Return the number of values that `event_tangents` writes."""
    columns, rows = 1 + n + directions, 2 * m + n
    return rows * (1 + columns) + Sizes(n, count, rows, width_for(columns)).memory


@cache
def event_tangents(
    margins: Callable[..., Any],
    transition: Callable[..., Any],
    n: int,
    m: int,
    count: int,
    directions: int,
    *,
    exact: bool = True,
) -> Callable[..., Any]:
    """Return ``tangents(mode, code, t, y, p, out)``, the derivatives of margins and a transition.

    The first of the values `out` are a table, for each of the margins (m), their rates (m) and the
    state after the transition (n): its value, and its derivatives by each component of the state,
    by time, and by each direction in the space of parameters. The directions follow the parameters
    (count). The other values are scratch.
    """
    columns, rows = 1 + n + directions, 2 * m + n
    sizes = Sizes(n, count, rows, width_for(columns))
    width, record, row = sizes.width, sizes.record, 1 + columns
    start = rows * row
    of_out = start + record * (1 + n + count)

    def event(mode, code, t, y, p, out):  # type: ignore[no-untyped-def]
        for i in range(2 * m):
            out[i] = 1.0
        margins(mode, t, y, p, out[:m], out[m : 2 * m])
        for i in range(n):
            out[2 * m + i] = y[i]
        transition(mode, code, t, out[2 * m :], p)

    derive = differentiated(event, transition, sizes, by_time=True, by_parameter=True, exact=exact)

    def tangents(mode, code, t, y, p, out):  # type: ignore[no-untyped-def]
        for first in range(1, row, width):
            for i in range(1 + n + count):
                place = start + record * i
                out[place] = t if i == 0 else (y[i - 1] if i <= n else p[i - n - 1])
                for k in range(width):
                    c = first + k
                    seed = 1.0 if i <= n and c == (i if i > 0 else n + 1) else 0.0
                    if i > n and n + 1 < c < row:
                        seed = p[count * (c - n - 1) + i - n - 1]
                    out[place + 1 + k] = seed
            derive(mode, code, p, out, start)
            for i in range(rows):
                place = of_out + record * i
                out[row * i] = out[place]
                for k in range(min(width, row - first)):
                    out[row * i + first + k] = out[place + 1 + k]

    return tangents


def tangents_of_events(
    problem: Problem, binding: EngineBinding, directions: int, exact: bool
) -> tuple[Any, Any]:
    """Return `event_tangents` of a problem as a reference, and an object that lives as long."""
    automaton, count = problem.automaton, len(problem.parameters)
    n, m = len(automaton.states), len(automaton.guards)
    tangents = event_tangents(
        automaton.margins, automaton.transition, n, m, count, directions, exact=exact
    )
    return binding.tangents_reference(tangents, n, table_size(n, m, count, directions))


Built = TypeVar("Built")


def exact_or_not(automaton: Automaton, build: Callable[[bool], Built]) -> Built:
    """Return ``build(True)``; ``build(False)`` if functions do not take numbers with tangents."""
    functions = automaton.flow, automaton.transition
    if not differences_reason(*functions):
        try:
            return build(True)
        except FunctionError:
            from mems_impact.hybrid.diagnostics.failures import explain_refusal

            result = build(False)  # raises the error of a function that cannot be compiled at all
            note_refusal(explain_refusal(automaton), *functions)
            return result
    return build(False)
