"""The random automata of `drawn`, as one automaton of the package whose parameters draw it.

A function of its own for each would have to be compiled; here only their numbers differ.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from mems_impact import Options
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.state import HybridState
from validation.campaign import comparing
from validation.campaign.comparing import ONE, Row, Unit, Verdict
from validation.campaign.drawn import IMPACT, MODES, RESET, Drawn
from validation.campaign.integrating import Follower

INTERPRETED = 50  # one case in so many runs on the interpreted engine

# p = (n, m, w, flow of each component of each mode, guards, guards in each mode).
HEAD = 3
CUBE = 3.0  # power of a margin


def _slope(mode, i, t, y, p):  # type: ignore[no-untyped-def]
    n = int(p[0])
    at = HEAD + (mode * n + i) * (n + 6)
    following = y[(i + 1) % n] / p[at + n + 4]
    total = p[at + n] + p[at + n + 1] * math.sin(p[2] * t + p[at + n + 2])
    total += p[at + n + 3] * math.sin(following) - p[at + n + 5] * y[i] ** 3
    for j in range(n):
        total += p[at + j] * y[j]
    return total


def _guard(guard, p):  # type: ignore[no-untyped-def]
    n = int(p[0])
    return HEAD + MODES * n * (n + 6) + guard * (2 * n + 8)


def _in_mode(mode, guard, p):  # type: ignore[no-untyped-def]
    n, m = int(p[0]), int(p[1])
    return _guard(m, p) + (mode * m + guard) * (2 * n + 4)


def _margin(mode, guard, t, y, p):  # type: ignore[no-untyped-def]
    n, at, here = int(p[0]), _guard(guard, p), _in_mode(mode, guard, p)
    wave = p[at + n + 1] * p[2] * t + p[at + n + 2]
    total = p[at + n] * math.sin(wave)
    total += p[at + n + 3] * math.sin(p[at + n + 4] * y[int(p[at + n + 5])])
    for j in range(n):
        total += p[at + j] * y[j]
    return p[here] * total + p[here + 1]


def _rate(mode, guard, t, y, p):  # type: ignore[no-untyped-def]
    n, at = int(p[0]), _guard(guard, p)
    turns = p[at + n + 1] * p[2]
    total = p[at + n] * turns * math.cos(turns * t + p[at + n + 2])
    of = int(p[at + n + 5])
    bend = p[at + n + 3] * p[at + n + 4] * math.cos(p[at + n + 4] * y[of])
    for j in range(n):
        weight = p[at + j] + (bend if j == of else 0.0)
        if weight != 0.0:
            total += weight * _slope(mode, j, t, y, p)
    return p[_in_mode(mode, guard, p)] * total


def _flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
    for i in range(int(p[0])):
        dy[i] = 0.0 if mode == MODES else _slope(mode, i, t, y, p)


def _margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
    if mode < MODES:
        for guard in range(int(p[1])):
            if p[_in_mode(mode, guard, p)] != 0.0:
                g[guard] = _margin(mode, guard, t, y, p)
                r[guard] = _rate(mode, guard, t, y, p)
                if p[_guard(guard, p) + 2 * int(p[0]) + 7] == CUBE:
                    r[guard] *= 3.0 * g[guard] ** 2
                    g[guard] = g[guard] ** 3


def _transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
    n, m = int(p[0]), int(p[1])
    guard = code % m
    at, here = _guard(guard, p), _in_mode(mode, guard, p)
    if code >= m or p[here + 3] == IMPACT:
        rebound = 0.0 if code >= m else p[at + n + 6]
        rate = _rate(mode, guard, t, y, p)
        for i in range(n):
            y[i] -= (1.0 + rebound) * rate * p[at + n + 7 + i]
    elif p[here + 3] == RESET:
        for i in range(n):
            y[i] = p[here + 4 + i] * y[i] + p[here + 4 + n + i]
    return MODES if code >= m else int(p[here + 2])


@cache
def automaton(
    n: int, orders: tuple[int, ...], impacts: tuple[bool, ...], conditions: tuple[bool, ...]
) -> Automaton:
    guards = (
        Guard(name=f"g{i}", order=order, impact=impact, condition=condition)
        for i, (order, impact, condition) in enumerate(
            zip(orders, impacts, conditions, strict=True)
        )
    )
    return Automaton(
        states=tuple(f"y{i}" for i in range(n)),
        modes=(*(f"m{i}" for i in range(MODES)), "stopped"),
        guards=tuple(guards),
        flow=_flow,
        margins=_margins,
        transition=_transition,
    )


def scale_of(drawn: Drawn, unit: Unit) -> np.ndarray:
    """Return what each component is measured in."""
    scale = np.full(drawn.n, unit.length)
    if drawn.mechanical:
        scale[1::2] = unit.speed
    return scale


def parameters(drawn: Drawn, unit: Unit) -> list[float]:
    """Return the numbers by which the automaton above is the drawn one, in these units."""
    n, m = drawn.n, drawn.m
    scale = scale_of(drawn, unit)
    p = [float(n), float(m), drawn.w / unit.time]
    for mode in range(MODES):
        if mode >= drawn.count:  # modes that nothing leads to
            p += ([0.0] * (n + 4) + [1.0, 0.0]) * n
            continue
        for i in range(n):
            fast = scale[i] / unit.time
            p += list(drawn.A[mode, i] / scale * fast)
            p += [drawn.b[mode, i] * fast, drawn.f[mode, i] * fast, drawn.phase[mode, i]]
            p += [drawn.c[mode, i] * fast, scale[(i + 1) % n]]
            p += [drawn.d[mode, i] * fast / scale[i] ** 3]
    for j in range(m):
        of = drawn.of[j]
        p += list(drawn.a[j] * unit.length / scale)
        p += [drawn.q[j] * unit.length, drawn.k[j], drawn.turn[j], drawn.s[j] * unit.length]
        p += [drawn.kappa[j] / scale[of], float(of), drawn.e[j]]
        p += [*(drawn.push[j] * scale / unit.speed), drawn.power[j]]
    for mode in range(drawn.count):
        for j in range(m):
            p += [drawn.sign[mode, j], drawn.offset[mode, j] * unit.length]
            p += [float(drawn.target[mode, j]), float(drawn.kind[mode, j])]
            p += [*drawn.keep[mode, j], *(drawn.shift[mode, j] * scale)]
    return [float(number) for number in p]


def check(seed: int, number: int, unit: Unit = ONE) -> Verdict:
    """Try one automaton whose margins are conditions of its modes."""
    return _check("automata", Drawn(seed, number), number, unit)


def check_guards(seed: int, number: int, unit: Unit = ONE) -> Verdict:
    """Try one automaton with guards that wait."""
    return _check("guards", Drawn(seed, number).with_waiting_guards(number), number, unit)


def _check(family: str, drawn: Drawn, number: int, unit: Unit) -> Verdict:

    def follow(shift: float) -> tuple[list[Row], float]:
        y = drawn.start + shift * drawn.direction
        # The shifted runs show how motions part: for that, fewer digits do.
        rtol = 1e-12 if shift == 0.0 else 1e-9
        return Follower(drawn, 0, 0.0, y, rtol).follow(drawn.end)

    found = comparing.truth(follow, drawn.end)
    engine = "interpreted" if number % INTERPRETED == INTERPRETED - 1 else "compiled"
    orders = tuple(int(order) for order in drawn.order)
    problem = Problem(
        automaton=automaton(
            drawn.n,
            orders,
            tuple(bool(wall) for wall in drawn.impact),
            tuple(bool(condition) for condition in drawn.condition),
        ),
        parameters=parameters(drawn, unit),
        period=drawn.period * unit.time,
        options=Options(**unit.options, engine=engine),
    )
    start = HybridState(0, 0.0, 0, drawn.start, initial=True)
    mine = comparing.answer(problem, start, found.quiet, scale_of(drawn, unit), unit.time)
    story = comparing.compare(found, mine)
    return Verdict(family, number, len(found.rows), found.share, story)
