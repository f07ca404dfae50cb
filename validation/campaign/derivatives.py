"""Derivatives of the random automata of `drawn`: interpreted, compiled and of 50 digits.

An error is relative to the largest term of a derivative along numbers of order one.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import mpmath
import numpy as np
from numba import njit

from mems_impact.integrators import dual_numbers
from mems_impact.integrators.dual_numbers import Dual, copy_for_tangents, plain
from mems_impact.integrators.jit.closures import take_snapshot
from mems_impact.integrators.jit.dual_numbers import vector_at
from mems_impact.integrators.jit.numba_support import JIT, WORD
from mems_impact.integrators.substitution import Substitution
from validation.campaign import automata
from validation.campaign.comparing import ONE, Unit, Verdict
from validation.campaign.drawn import Drawn

LIMIT = 1e-12  # relative to the largest derivative of the function, not to the largest term
ROUNDING = 4e-15  # between compiled and interpreted code
WIDTH = 8  # tangents of compiled numbers: of time and at most six states
NAMES = "sin cos tan asin atan sinh cosh tanh exp log sqrt hypot atan2 floor"


class Exact:
    """A function of mpmath, which is not copied."""

    def __init__(self, call: Any) -> None:
        self.call = call

    def __call__(self, *arguments: Any) -> Any:
        return self.call(*arguments)


_FUNCTIONS: dict[Any, Any] = {
    **{getattr(math, name): Exact(getattr(mpmath, name)) for name in NAMES.split()},
    math.copysign: Exact(lambda a, b: abs(a) if b >= 0 else -abs(a)),
    float: Exact(mpmath.mpf),
}
_exact_copies = Substitution(_FUNCTIONS, _FUNCTIONS, dual_numbers.__name__)


def called(kind: str, function: Any, automaton: Any, mode: int, code: int, numbers: Any) -> Any:
    """Return the results of a flow, margins or a transition at time, state and parameters."""
    n = len(automaton.states)
    t, y, p = numbers[0], list(numbers[1 : 1 + n]), list(numbers[1 + n :])
    if kind == "transition":
        function(mode, code, t, y, p)
        return y
    results = [[1.0] * max(n, len(automaton.guards)) for _ in range(1 + (kind == "margins"))]
    function(mode, t, y, p, *results)
    return results[0]


def tangents(kind: str, automaton: Any, mode: int, code: int, numbers: Any, count: int) -> Any:
    """Return the derivatives by the first numbers, interpreted; values keep their bits."""
    function, given = getattr(automaton, kind), (automaton, mode, code)
    seeds = [Dual(v, np.eye(count)[i]) if i < count else v for i, v in enumerate(numbers)]
    results = called(kind, copy_for_tangents(function), *given, seeds)
    assert [plain(each) for each in results] == called(kind, function, *given, list(numbers))
    return np.array([x.slope if isinstance(x, Dual) else np.zeros(count) for x in results])


def error(kind: str, automaton: Any, mode: int, code: int, numbers: Any, slopes: Any) -> float:
    """Return the largest error of derivatives, relative to the largest term."""
    copy, given = _exact_copies.function(getattr(automaton, kind)), (automaton, mode, code)
    count, step = slopes.shape[1], mpmath.mpf(10) ** -20
    terms = np.zeros(slopes.shape)
    for i in range(count):
        ends = []
        for h in (step, -step):
            moved = [mpmath.mpf(v) if j < count else v for j, v in enumerate(numbers)]
            moved[i] += h
            ends.append(called(kind, copy, *given, moved))
        terms[:, i] = [(up - down) / (2 * step) for up, down in zip(*ends, strict=True)]
    return _apart(slopes, terms, numbers)


def _apart(slopes: Any, terms: Any, numbers: Any) -> float:
    sizes = np.abs(numbers[: terms.shape[1]])
    scale = np.abs(terms * sizes).max(axis=1, keepdims=True)
    return float((np.abs(slopes - terms) * sizes / np.where(scale > 0.0, scale, 1.0)).max())


@cache
def _machine(kind: str, function: Any) -> Any:
    (copy,), at = take_snapshot(function).frozen(), vector_at(WIDTH)

    @njit(**JIT)
    def transition(mode, code, n, p, records, out, rates):  # type: ignore[no-untyped-def]
        y = at(records.ctypes.data + WORD * (1 + WIDTH), n)
        copy(mode, code, at(records.ctypes.data, 1)[0], y, p)

    @njit(**JIT)
    def margins(mode, code, n, p, records, out, rates):  # type: ignore[no-untyped-def]
        y, size = at(records.ctypes.data + WORD * (1 + WIDTH), n), len(out)
        g, r = at(out.ctypes.data, size), at(rates.ctypes.data, size)
        copy(mode, at(records.ctypes.data, 1)[0], y, p, g, r)

    @njit(**JIT)
    def flow(mode, code, n, p, records, out, rates):  # type: ignore[no-untyped-def]
        y = at(records.ctypes.data + WORD * (1 + WIDTH), n)
        copy(mode, at(records.ctypes.data, 1)[0], y, p, at(out.ctypes.data, len(out)))

    return {"flow": flow, "margins": margins, "transition": transition}[kind]


def compiled(kind: str, automaton: Any, mode: int, code: int, numbers: Any, count: int) -> Any:
    """Return the same derivatives of compiled code."""
    n, m = len(automaton.states), len(automaton.guards)
    records = np.zeros((1 + n, 1 + WIDTH))
    records[:, 0], records[:, 1 : 2 + n] = numbers[: 1 + n], np.eye(1 + n)
    out, rates = np.zeros((2, max(n, m), 1 + WIDTH))
    out[:, 0] = 1.0
    p = np.array(numbers[1 + n :])
    _machine(kind, getattr(automaton, kind))(mode, code, n, p, records, out, rates)
    return (records[1:] if kind == "transition" else out)[:, 1 : 1 + count]


def check(seed: int, number: int, _unit: Unit = ONE) -> Verdict:
    """Try all functions of an automaton; its events are the functions that are right."""
    drawn, verdict = Drawn(seed, number), Verdict("derivatives", number)
    if number % 2:
        drawn = drawn.with_waiting_guards(number)
    flags = (True,) * drawn.m
    automaton = automata.automaton(drawn.n, tuple(drawn.order.tolist()), flags, flags)
    p, rng = automata.parameters(drawn, ONE), np.random.default_rng([seed, number, 9])
    calls = [("flow", 0), ("margins", 0), *(("transition", code) for code in range(drawn.m))]
    for mode in range(drawn.count):
        numbers = [rng.uniform(0.0, 6.0), *rng.uniform(-1.0, 1.0, drawn.n).tolist(), *p]
        for kind, code in calls:
            given, count = (kind, automaton, mode, code, numbers), 1 + drawn.n
            slopes = tangents(*given, count)
            with mpmath.workdps(50):
                wrong = error(*given, slopes)
            differ = _apart(compiled(*given, count), slopes, numbers)
            if wrong < LIMIT and differ < ROUNDING:
                verdict.events += 1
            else:
                verdict.story = f"{kind} {code} in mode {mode}: {wrong:.1e}, compiled {differ:.1e}"
    return verdict
