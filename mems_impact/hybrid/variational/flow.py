"""Vector fields of the variational equations, and derivatives of events.

A *column* is a perturbation: one for each component of the initial state that is not cyclic, then
one for each direction in the space of parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import FunctionError
from mems_impact.hybrid.automaton import Automaton, unguarded
from mems_impact.hybrid.engine import EngineBinding, Extension
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.variational.tangents import (
    Sizes,
    differences_reason,
    differentiated,
    evaluate,
    event_sizes,
    note_refusal,
    split_numbers,
    width_for,
    with_code,
)

MAX_WIDTH = 12  # tangents of a call of the flow; more columns take several calls


def with_columns(
    automaton: Automaton,
    flow: Callable[..., Any],
    parameters: Floats,
    size: int,
    *,
    guarded: bool = False,
    known: bool = True,
) -> Extension:
    """Return the equations of `size` components, state and columns, with their flow.

    Unless `guarded`, they have no margins; they have the transitions in any case.
    """
    watched = automaton if guarded else unguarded(automaton)
    extended = Automaton(
        states=tuple(f"y{i}" for i in range(size)),
        modes=automaton.modes,
        guards=watched.guards,
        flow=flow,
        margins=watched.margins,
        transition=automaton.transition,
        bounds=automaton.bounds,
    )
    return Extension(extended, parameters, size - len(automaton.states), known)


def extended_parameters(p: Floats, directions: Floats, n: int, columns: int) -> Floats:
    """Return the parameters of `tangent_flow`.

    They are p, the directions (shape (k, count)), the tangents of p (shape (count, columns)) if
    there are directions, and scratch.
    """
    k, count = len(directions), p.size
    scratch = Sizes(n, count, n, width_for(columns)).memory
    tangents = count * (1 + k)
    values = np.zeros(tangents + (count * columns if k else 0) + scratch)
    values[:count] = p
    if k:
        values[count:tangents] = directions.ravel()
        by_column = values[tangents : tangents + count * columns].reshape(count, columns)
        by_column[:, columns - k :] = directions.T
    return values


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

    The extended state is y (n), then for each component its perturbations (columns): those of the
    initial state, then those of the parameters, one for each direction. The parameters are
    `extended_parameters`.
    """
    coded, width = with_code(flow), min(columns, MAX_WIDTH)
    calls, of_p = math.ceil(columns / width), count * (1 + directions)
    by_differences = _flow_by_differences(flow, n, count, columns, directions)

    def numbers(p, first):  # type: ignore[no-untyped-def]
        return split_numbers(p, count, p, of_p + first, columns, width)

    def constants(p, first):  # type: ignore[no-untyped-def]
        return p

    parameters = numbers if directions else constants

    def extended(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        for call in range(calls):
            first = min(width * call, columns - width)  # the last two calls may share columns
            state = split_numbers(y, n, y, n + first, columns, width)
            slope = split_numbers(dy, n, dy, n + first, columns, width)
            arguments = mode, 0, t, state, parameters(p, first), slope
            evaluate(coded, flow, by_differences, arguments, (mode, t, y, p, dy))

    return extended if exact else by_differences


def _flow_by_differences(
    flow: Callable[..., Any], n: int, count: int, columns: int, directions: int
) -> Callable[..., Any]:
    """Return the flow of the state and its columns by differences."""
    sizes = Sizes(n, count, n, width_for(columns))
    width, record = sizes.width, sizes.record
    of_p, of_slope = record * (1 + n), record * (1 + n + count)
    tangents = count * (1 + directions)
    scratch = tangents + (count * columns if directions else 0)
    derive = differentiated(
        with_code(flow), flow, sizes, by_time=False, by_parameter=directions > 0, exact=False
    )

    def extended(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        p[scratch] = t
        for first in range(0, columns, width):
            for i in range(n):
                place = scratch + record * (1 + i)
                p[place] = y[i]
                for k in range(width):
                    c = first + k
                    p[place + 1 + k] = y[n + columns * i + c] if c < columns else 0.0
            for i in range(count if directions else 0):
                place = scratch + of_p + record * i
                p[place] = p[i]
                for k in range(width):
                    c = first + k
                    p[place + 1 + k] = p[tangents + columns * i + c] if c < columns else 0.0
            derive(mode, 0, p, p, scratch)
            for i in range(n):
                place = scratch + of_slope + record * i
                dy[i] = p[place]
                for k in range(min(width, columns - first)):
                    dy[n + columns * i + first + k] = p[place + 1 + k]

    return extended


@cache
def event_tangents(
    margins: Callable[..., Any],
    transition: Callable[..., Any],
    m: int,
    sizes: Sizes,
    *,
    exact: bool = True,
) -> Callable[..., Any]:
    """Return ``tangents(mode, code, t, y, p, memory)``, which differentiates an event.

    The memory has the records of time, state, parameters and results: the margins (m), their rates
    (m) and the state after the transition. Time, state and parameters are those of the records.
    """

    def event(mode, code, t, y, p, out):  # type: ignore[no-untyped-def]
        for i in range(2 * m):
            out[i] = 1.0
        margins(mode, t, y, p, out[:m], out[m : 2 * m])
        after = out[2 * m :]
        for i in range(len(y)):
            after[i] = y[i]
        transition(mode, code, t, after, p)

    derive = differentiated(event, transition, sizes, by_time=True, by_parameter=True, exact=exact)

    def tangents(mode, code, _t, _y, p, memory):  # type: ignore[no-untyped-def]
        derive(mode, code, p, memory, 0)

    return tangents


def tangents_of_events(
    problem: Problem, binding: EngineBinding, directions: int, exact: bool
) -> tuple[Any, Any]:
    """Return `event_tangents` of a problem as a reference, and an object that lives as long."""
    automaton, count = problem.automaton, len(problem.parameters)
    n, m = len(automaton.states), len(automaton.guards)
    sizes = event_sizes(n, m, count, directions)
    tangents = event_tangents(automaton.margins, automaton.transition, m, sizes, exact=exact)
    return binding.tangents_reference(tangents, n, sizes.memory)


Built = TypeVar("Built")


def exact_or_not(automaton: Automaton, build: Callable[[bool], Built]) -> Built:
    """Return ``build(True)``; ``build(False)`` if functions do not take numbers with tangents."""
    if not differences_reason(automaton):
        try:
            return build(True)
        except FunctionError:
            from mems_impact.hybrid.diagnostics.failures import explain_refusal

            result = build(False)  # raises the error of a function that cannot be compiled at all
            note_refusal(explain_refusal(automaton), automaton.flow, automaton.transition)
            return result
    return build(False)
