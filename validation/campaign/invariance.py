"""The same run told in other ways."""

from __future__ import annotations

import multiprocessing as mp
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import mems_impact as mi
from mems_impact.actuator.units import DeviceScales
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import run
from validation.campaign.cases import Case, random_case
from validation.campaign.checks import parting, rows_of
from validation.campaign.result import Result

CHEAP = ("sine", "square", "pulse", "trapezoid", "sampled")


def drawn(seed: int, count: int) -> list[Case]:
    """Random cases of the drives that share two automata, with short runs."""
    cases, number = [], 1_000_000
    while len(cases) < count:
        case = random_case(seed, number)
        number += 1
        if case.drive.kind in CHEAP:
            cases.append(replace(case, periods=min(case.periods, 6.0)))
    return cases


def finished(case: Case, **changes: Any) -> Any:
    try:
        return case.run(**changes).trajectory
    except mi.RunError as error:
        return error.partial.trajectory  # type: ignore[attr-defined]


def same(a: Any, b: Any) -> bool:
    """Whether two runs are the same to the last bit."""
    logs = zip(vars(a.events).values(), vars(b.events).values(), strict=True)
    equal = all(np.array_equal(x, y) for x, y in logs)
    return equal and np.array_equal(a.final.y, b.final.y) and a.final.time == b.final.time


def units(seed: int, small: bool) -> Result:
    """SI and dimensionless: one and the same to rounding, as far as rounding does not grow."""
    scales = DeviceScales.of_device(2.1e-6, 4.7, 5e-6, 8.9e-20)
    tried = apart = events = 0
    findings = []
    for case in drawn(seed, 12 if small else 200):
        device = {**case.device, "m2": 1.0, "k": 1.0, "d": 1.0, "alpha": 1.0}
        device["delta"] = case.device["delta"] / case.device["d"]
        start = tuple(0.5 * np.sign(x) * device["delta"] for x in case.start)
        case = replace(case, device=device, start=start, time=0.0)
        plain = finished(case)
        x1, v1, x2, v2 = (x * scales.length for x in start)
        try:
            si = mi.simulate(
                case.actuator.to_si(scales),
                case.drive.build().scaled(1.0 / scales.voltage, 1.0 / scales.time),
                case.periods,
                initial=mi.State(x1=x1, v1=v1 / scales.time, x2=x2, v2=v2 / scales.time),
                options=mi.Options(**case.options),
            ).trajectory
        except mi.RunError as error:
            si = error.partial.trajectory  # type: ignore[attr-defined]
        tried += 1
        rows = rows_of(plain)[:60]
        until = rows[-1].t if rows else 0.0
        when, matched, how = parting(rows, rows_of(si), until, 1e-3)
        events += matched
        # What rounding does to a chaotic run is the judge's matter: the start must agree.
        if matched < min(5, len(rows)) and np.isfinite(when):
            apart += 1
            findings.append(f"{case.name} parts at {when:.6g}: {how}")
    return Result("SI and dimensionless", tried, f"{events} events matched", findings)


def grids(seed: int, small: bool) -> Result:
    """Samples of any density lie on one trajectory, and the run is the same without them."""
    findings, tried, worst = [], 0, 0.0
    for case in drawn(seed + 1, 12 if small else 200):
        first = finished(case)
        coarse, fine = first.samples(7), first.samples(21)
        tried += 1
        every = fine.y[::3]
        if first.start.time == 0.0:
            # The times of the two grids differ in their last bit; at an impact, by its jump.
            off = np.abs(coarse.y[:, 2] - every[: len(coarse.y), 2]).max()
            worst = max(worst, float(off) / case.device["delta"])
        if not same(first, finished(case)):
            findings.append(f"{case.name}: a second run differs")
    if worst > 1e-12:
        findings.append(f"samples differ by {worst:.1e}")
    figures = f"samples within {worst:.0e}, repeated runs equal to the last bit"
    return Result("output grids, repeated runs", tried, figures, findings)


@cache
def permuted(automaton: Automaton, places: tuple[int, ...]) -> Automaton:
    """Return the automaton with its guards listed in another order."""
    m = len(places)
    back = tuple(places.index(i) for i in range(m))

    def margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
        values, rates = [1.0] * m, [1.0] * m
        automaton.margins(mode, t, y, p, values, rates)
        for i in range(m):
            g[i] = values[places[i]]
            r[i] = rates[places[i]]

    def transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
        if code < m:
            code = places[code]
        elif code < 2 * m:
            code = m + places[code - m]
        return automaton.transition(mode, code, t, y, p)

    assert sorted(back) == list(range(m))
    guards = tuple(automaton.guards[i] for i in places)
    return replace(automaton, guards=guards, margins=margins, transition=transition)


def order_of_guards(seed: int, small: bool) -> Result:
    """Guards listed in another order give the same run (interpreted engine), to the last bit."""
    rng = np.random.default_rng(seed)
    findings, tried = [], 0
    for case in drawn(seed + 2, 8 if small else 60):
        options = mi.Options(**{**case.options, "engine": "interpreted"})
        system = case.actuator.under(case.drive.build())
        problem = system.problem(options)
        start = system.state_space.instant(case.initial, problem)
        places = tuple(int(i) for i in rng.permutation(len(problem.automaton.guards)))
        logs = []
        for automaton in (problem.automaton, permuted(problem.automaton, places)):
            setup = replace(problem, automaton=automaton)
            try:
                done = run(setup, start, min(case.periods, 0.3 if small else 2.0))
            except mi.RunError as error:
                done = error.partial  # type: ignore[assignment]
            events = done.events
            events = events[events.kind != workspace.APPROACH]
            names = [setup.automaton.guards[g].name for g in events.guard[events.kind <= 1]]
            logs.append((events.time, events.after, names))
        tried += 1
        a, b = logs
        if not (np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1]) and a[2] == b[2]):
            findings.append(f"{case.name}: the order {places} changes the run")
    return Result("guards in another order", tried, "equal to the last bit", findings)


def _final(case: Case) -> tuple[Any, ...]:
    done = finished(case)
    return done.final.y.tobytes(), done.events.time.tobytes(), done.events.after.tobytes()


def processes(seed: int, small: bool) -> Result:
    """One process and four give the same, to the last bit."""
    cases = drawn(seed + 3, 8 if small else 40)
    here = [_final(case) for case in cases]
    with mp.get_context("spawn").Pool(2 if small else 4) as pool:
        there = pool.map(_final, cases)
    findings = [c.name for c, a, b in zip(cases, here, there, strict=True) if a != b]
    return Result("one process and four", len(cases), "equal to the last bit", findings)


ATTACKS: list[Callable[..., Result]] = [units, grids, order_of_guards, processes]
