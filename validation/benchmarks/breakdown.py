"""Where the time of the compiled engine goes: counts, and what leaving things out saves.

``python -m validation.benchmarks.breakdown`` from the root of the repository. For the share of each
C function run it under ``perf record -e cycles:u`` and ``perf report --sort dso,symbol``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from mems_impact.actuator.device_files import load_actuator
from mems_impact.actuator.drives import Sine
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.jit.numba_support import pointer
from mems_impact.integrators.options import Options
from validation.benchmarks.contestants import CASES, START, Case
from validation.benchmarks.timing import in_turn, ratio, scaled

FLOW, MARGINS, TRANSITION = 0, 1, 2


@cache
def counting(base: Automaton) -> Automaton:
    """The automaton with a count of its calls, at the address in its last parameter."""
    base_flow, base_margins, base_transition = base.flow, base.margins, base.transition

    def flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        pointer(int(p[p.size - 1]))[FLOW] += 1.0
        base_flow(mode, t, y, p, dy)

    def margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
        pointer(int(p[p.size - 1]))[MARGINS] += 1.0
        base_margins(mode, t, y, p, g, r)

    def transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
        pointer(int(p[p.size - 1]))[TRANSITION] += 1.0
        return base_transition(mode, code, t, y, p)

    return replace(base, flow=flow, margins=margins, transition=transition)


@cache
def without_load_rate(base: Automaton) -> Automaton:
    """The automaton that looks for closest approaches, as impacts need, but for no other apex."""
    base_margins = base.margins

    def margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
        base_margins(mode, t, y, p, g, r)
        for i in range(2, 5):
            r[i] = 1.0

    return replace(base, margins=margins)


@cache
def without_voltage(base: Automaton) -> Automaton:
    """The automaton that watches impacts and ends of slips, with rates, and evaluates no drive."""

    def margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
        g[0], r[0] = p[5] - y[2], -y[3]
        g[1], r[1] = p[5] + y[2], y[3]
        if mode == 1:
            g[3] = y[1]
        elif mode == 2:
            g[3] = -y[1]

    return replace(base, margins=margins)


def problem(case: Case, variant: Callable[[Automaton], Automaton], **changes: Any) -> Problem:
    """The paper's set under `case`; `changes` are options, or the section."""
    section = changes.pop("section", None)
    drive = Sine(amplitude=case.amplitude, omega=case.omega)
    system = load_actuator("zhao2004").under(drive)
    return Problem(
        automaton=variant(system.automaton),
        parameters=system.numbers().parameters,
        period=drive.period,
        section=section,
        options=Options(**({"rtol": 1e-9, "atol": 1e-11, "engine": "compiled"} | changes)),
    )


def go(task: Problem, periods: int) -> Any:
    return run(task, HybridState(0, 0.0, 0, np.array(START)), periods)


def counts(case: Case, periods: int, **options: float) -> str:
    """Calls and steps per forcing period, as a line."""
    calls = np.zeros(3)
    task = problem(case, counting, section=(2, 0.0, 1), **options)
    task = replace(task, parameters=np.append(task.parameters, float(calls.ctypes.data)))
    result = go(task, periods)
    calls /= periods
    return (
        f"{result.steps / periods:6.1f} steps {result.arcs / periods:5.2f} arcs "
        f"{calls[FLOW]:6.1f} right-hand sides {calls[MARGINS]:6.1f} margins "
        f"{len(result.events) / periods:5.2f} events"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--periods", type=int, default=1000)
    arguments = parser.parse_args()
    periods = arguments.periods
    for case in CASES:
        print(f"\n{case.name}, per forcing period")
        for rtol in (1e-6, 1e-9, 1e-11):
            print(f"  rtol {rtol:.0e}: {counts(case, periods, rtol=rtol, atol=0.01 * rtol)}")
        same, section = (lambda base: base), (2, 0.0, 1)
        tasks = {
            "all": problem(case, same, section=section),
            "no section": problem(case, same),
            "no section, rates of gaps only": problem(case, without_load_rate),
            "no section, no voltage": problem(case, without_voltage),
            "all, rtol 1e-6": problem(case, same, section=section, rtol=1e-6, atol=1e-8),
            "all, rtol 1e-11": problem(case, same, section=section, rtol=1e-11, atol=1e-13),
            "all, atol = rtol": problem(case, same, section=section, atol=1e-9),
            "all, BDF": problem(case, same, section=section, method="bdf"),
        }
        jobs = {name: (lambda task=task: go(task, periods)) for name, task in tasks.items()}
        steps = {name: go(task, periods).steps / periods for name, task in tasks.items()}
        seconds = in_turn(jobs, arguments.rounds)
        for name, times in seconds.items():
            cost, share = scaled(times, 1e6 / periods), ratio(times, seconds["all"])
            each = 1e3 * cost.median / steps[name]
            print(
                f"  {name:31} {cost.median:6.1f} us ({cost.low:.1f} to {cost.high:.1f})  "
                f"{steps[name]:6.1f} steps of {each:4.0f} ns  {share.median:5.2f} of all"
            )


if __name__ == "__main__":
    main()
