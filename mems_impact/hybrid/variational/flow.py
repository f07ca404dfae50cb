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
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.problem import EngineBinding, Problem
from mems_impact.hybrid.variational.tangents import (
    Sizes,
    differences_reason,
    differentiated,
    event_sizes,
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


def extended_parameters(p: Floats, directions: Floats, n: int, columns: int) -> Floats:
    """Return the parameters of `tangent_flow`: p, the directions (shape (k, count)), and scratch.

    The scratch has the records of each call, in which those of the parameters do not change.
    """
    k, count = len(directions), p.size
    sizes = Sizes(n, count, n, width_for(columns))
    width, record = sizes.width, sizes.record
    scratch = np.zeros((math.ceil(columns / width), sizes.memory))
    first = record * (1 + n)
    records = scratch[:, first : first + record * count].reshape(len(scratch), count, record)
    records[:, :, 0] = p
    for c, direction in enumerate(directions, columns - k):
        records[c // width, :, 1 + c % width] = direction
    return np.concatenate([p, np.ravel(directions), scratch.ravel()])


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
    the parameters, one for each direction. The parameters are `extended_parameters`.
    """
    sizes = Sizes(n, count, n, width_for(columns))
    width, record, length = sizes.width, sizes.record, sizes.memory
    of_slope, scratch = record * (1 + n + count), count * (1 + directions)
    derive = differentiated(
        with_code(flow), flow, sizes, by_time=False, by_parameter=directions > 0, exact=exact
    )

    def extended(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        for first in range(0, columns, width):
            start = scratch + first // width * length
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
