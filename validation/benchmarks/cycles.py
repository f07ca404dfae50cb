"""A limit cycle of the belt oscillator and a branch of them, in runs of a thousand periods."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mems_impact as mi
from validation.benchmarks.timing import Row, Spread, in_turn, ratio

TOPIC = "cycle"
PERIODS = 1_000  # of the run that is the unit
POINTS = 100  # of the branch
CYCLE, BRANCH = "<= 2", "<= 100"
BRANCH_SECONDS = "<= 0.3"

STICK, SLIP = mi.modes("stick", "slip")


def flow(mode: int, t: float, y: Any, p: Any) -> tuple[float, float]:
    return (p.v, 0.0) if mode == STICK else (y.v, p.Fd - y.x)


def held(mode: int, t: float, y: Any, p: Any) -> float:
    return float(p.Fs - y.x)


def slip(mode: int, t: float, y: Any, p: Any) -> Any:
    return SLIP, (y.x, p.v)


def slower(mode: int, t: float, y: Any, p: Any) -> float:
    return float(p.v - y.v)


def stick(mode: int, t: float, y: Any, p: Any) -> Any:
    return STICK, (y.x, p.v)


def cycles(quick: bool) -> Iterator[Row]:
    belt = mi.System(
        states=("x", "v"),
        flow=flow,
        parameters={"v": 0.3, "Fs": 1.0, "Fd": 0.6},
        guards=[
            mi.Guard("break-away", held, slip, modes=(STICK,)),
            mi.Guard("stick", slower, stick, modes=(SLIP,)),
        ],
        initial=mi.State(x=0.0, v=0.1, mode="slip"),
    )
    orbit = mi.find_orbit(belt)
    steps = mi.StepControl(max_step=0.02, max_points=POINTS)
    count = len(mi.continue_solution(orbit, "v", 10.0, steps=steps))
    jobs = {
        "run": lambda: mi.simulate(belt, duration=PERIODS * orbit.period, initial=orbit.state),
        "cycle": lambda: mi.find_orbit(belt).multipliers,
        "branch": lambda: mi.continue_solution(orbit, "v", 10.0, steps=steps),
    }
    times = in_turn(jobs, 1 if quick else 15)
    yield Row(TOPIC, f"run of {PERIODS:,} periods", "simulate", Spread.of(times["run"]), "s")
    for name, case, target, seconds in (
        ("cycle", "a cycle with multipliers, from rest", CYCLE, ""),
        ("branch", f"a branch of {count} cycles", BRANCH, BRANCH_SECONDS),
    ):
        yield Row(TOPIC, case, name, Spread.of(times[name]), "s", seconds)
        yield Row(TOPIC, case, f"{name} / run", ratio(times[name], times["run"]), target=target)
