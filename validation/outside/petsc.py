"""Event tests and hybrid tutorials of PETSc: times of events, derivatives through events."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import mems_impact as mi
from validation.outside.case import Case, Refused, Suite

__all__ = ["SUITE"]

Function = Callable[[float], float]
SHORT = mi.Options(engine="interpreted")  # compiling takes longer than a run
FOLDER = "src/ts/event/tests/output"
TUTORIALS = "src/ts/tutorials"
ERRORS = {"ex4_F7revisit": 0.005}  # option -errtol of the tests, by default:
ERROR = 1e-5
TIMES = re.compile(r"^(?:\d+\t(\S+)\t|PostEvent.* time (\S+))", re.MULTILINE)


# --- Functions of time


def line(zero: float, slope: float = 1.0) -> Function:
    return lambda t: slope * (t - zero)


def before(end: float, power: int, size: float = 1.0) -> Function:
    """Return a function with a zero 1 before `end`, and constant after `end`."""
    return lambda t: size * (1.0 - (end - t) ** power) if t < end else size


def after(start: float, power: int, size: float = 1.0) -> Function:
    return lambda t: size * (1.0 - (t - start) ** power) if t > start else size


def sine(t):  # type: ignore[no-untyped-def]
    return math.sin(math.pi * t)


HARD = (  # functions of published tests of root finding
    lambda t: math.sin(math.pi * t) / math.pi,
    lambda t: math.log(t),
    before(2.0, 12, 1.0 / 12.0),
    lambda t: t - math.exp(math.sin(t)) + 1.0,
    lambda t: (1e10 * t ** (1.0 / t) - 1.0) / 100.0,
    lambda t: math.log(t - 0.02) ** 2 * (1e7 if t > 1.02 else -1e7),
    lambda t: 4.0 * math.cos(t) - math.exp(t),
    lambda t: (20.0 * t - 1.0) / (19.0 * t) / 10.0,
    lambda t: ((t - 1.0) * math.exp(-20.0 * t) + t**20) * 1e4,
    lambda t: (t * t * (t * t / 3.0 + math.sqrt(2.0) * math.sin(t)) - math.sqrt(3.0) / 18.0) * 10.0,
    lambda t: (
        ((t * t + 1.0) * math.sin(t) - math.exp(math.sqrt(t)) * (t - 1.0) * (t * t - 5.0)) / 10.0
    ),
    lambda t: 2.0 * t - 5.0,
)
PAIR = before(2.05, 12, 0.5), after(8.05, 12, 0.25), sine
SIXTEEN = (
    *(before(2.0 + 2.0**i, i + 5) for i in range(-3, 4)),
    *(after(8.0 - 2.0**i, i + 5) for i in range(-3, 4)),
    lambda t: (t - 5.0) ** 2 * math.sin(math.pi * t),
    lambda t: 0.5 * math.cos(math.pi * t),
)
# Functions, start and end by the name of the test.
TESTS: dict[str, tuple[Sequence[Function], float, float]] = {
    "ex1": ((line(5.0), line(7.0, -1.0), line(9.0)), 0.0, 11.0),
    "ex16": ((line(1.1), line(1.2, -1.0), line(1.3)), 0.0, 2.0),
    "ex1sin": ((sine,), 0.0, 10.0),
    "ex2": ((before(2.0, 12, 0.5), after(8.0, 12, 0.25)), 0.0, 10.0),
    "ex3": (PAIR, 0.0, 10.0),
    "ex3span": (PAIR, 0.0, 10.0),
    "ex4": (HARD, 0.03, 4.0),
    "ex5": (SIXTEEN, 0.0, 10.0),
}


# --- Tutorials

# Balls by the name of the tutorial: each starts at the first height, and is put to the second.
BALLS = {
    "ex40": [(0.0, 0.0)],
    "ex41": [(0.0, 0.0), (1.0, 1.0)],
    "ex44": [(0.0, 0.0)],
    "ex44_2": [(0.0, 0.0), (5.0, 0.0)],
}
FIRST, SECOND = mi.modes("first", "second")
DIGITS = 0.005  # of the times of balls
STEPS = 0.02  # relative, of 32 steps of Crank and Nicolson's method
HIT = re.compile(r"at t = +(\S+) seconds")
CHANGE = re.compile(r"(?:at t =|/ ?d [^=]*=) +(\S+)")


def ball(start: float, level: float) -> mi.System:
    def bounce(mode, t, y, p):  # type: ignore[no-untyped-def]
        return mode, (level, -0.9 * y.v)

    return mi.System(
        states=("h", "v"),
        flow=lambda mode, t, y, p: (y.v, -9.8),
        guards=[mi.Guard("ground", lambda mode, t, y, p: y.h, bounce)],
        initial={"h": start, "v": 20.0},
    )


def hits(name: str, end: float) -> list[float]:
    """Return the times of all balls at the ground."""
    balls = BALLS.get(name) or BALLS[name.partition("_")[0]]
    runs = [mi.simulate(ball(*each), duration=end, options=SHORT) for each in balls]
    return sorted(t for run in runs for t in run.events["t"])


def foci() -> mi.System:
    """Two linear foci, between which two lines switch."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        if mode == FIRST:
            return y.u - 100.0 * y.v, 10.0 * y.u + y.v
        return y.u + 10.0 * y.v, -100.0 * y.u + y.v

    def steep(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.v - p.steep * y.u

    def level(mode, t, y, p):  # type: ignore[no-untyped-def]
        return 0.36 * y.u - y.v

    guards = [
        mi.Guard("steep", steep, lambda mode, t, y, p: (SECOND, y), modes=(FIRST,)),
        mi.Guard("level", level, lambda mode, t, y, p: (FIRST, y), modes=(SECOND,)),
    ]
    return mi.System(
        states=("u", "v"),
        flow=flow,
        guards=guards,
        modes=(FIRST, SECOND),
        initial={"v": 1.0},
        parameters={"steep": 2.75},
    )


def changes(count: int) -> list[float]:
    """Return the times of changes and, of more numbers, derivatives of the end."""
    if not count:
        raise Refused("an output of steps")
    run = mi.simulate(foci(), duration=0.125)
    derivatives = run.derivatives(["x0.u", "x0.v", "steep"]).final
    return [*run.events["t"], *derivatives.to_numpy().T.ravel()][:count]


# --- Cases


def cases(folder: Path) -> Iterator[Case]:
    """Yield the cases: an output each."""
    for path in sorted(folder.glob(f"{TUTORIALS}/output/ex4[014]*.out")):
        if found := numbers(HIT, path):
            yield Case(
                name=path.stem,
                group="bouncing balls",
                values=partial(hits, path.stem, found[-1] + DIGITS),
                reference=found,
                absolute=DIGITS,
                relative=0.0,
            )
    for path in sorted(folder.glob(f"{TUTORIALS}/hybrid/output/*.out")):
        found = numbers(CHANGE, path)
        yield Case(
            name=f"hybrid/{path.stem}",
            group="switched foci",
            values=partial(changes, len(found)),
            reference=found,
            absolute=0.0,
            relative=STEPS,
        )
    for path in sorted(folder.glob(f"{FOLDER}/*.out")):
        yield Case(
            name=path.stem,
            group="zeros of functions of time",
            values=partial(zeros, path.stem, path.read_text()),
            reference=times(path.read_text()),
            absolute=ERRORS.get(path.stem, ERROR),
            relative=0.0,
        )


def numbers(pattern: re.Pattern[str], path: Path) -> list[float]:
    """Return the numbers of an output; those of a repeated solution once."""
    return [float(each) for each in dict.fromkeys(pattern.findall(path.read_text()))]


def times(output: str) -> list[float]:
    """Return the times of an output; those of a repeated solution once."""
    found = [float(each[0] or each[1]) for each in TIMES.findall(output)]
    return list(dict.fromkeys(found)) if "PostEvent" in output else sorted(found)


def zeros(name: str, output: str) -> Any:
    """Return the times of all zeros."""
    if not times(output):
        raise Refused("an output without times")
    test, _, variant = name.partition("_")
    functions, start, end = TESTS[test]
    if variant.startswith("F7"):
        functions = functions[7:8]
    if match := re.search(r"Final time = (\S+),", output):
        end = float(match[1])
    elif "REASON: 4" in output:  # an event ended the run
        end = times(output)[-1]
    only_up = variant.startswith(("p", "adapt"))
    only_down = variant.startswith("n") and not variant.startswith("neu")
    guards = []
    for i, function in enumerate(functions):
        if not only_up:
            guards.append(mi.Guard(f"{i} falls", margin(function, 1.0)))
        if not only_down:
            guards.append(mi.Guard(f"{i} rises", margin(function, -1.0)))
    system = mi.System(states=("x", "y"), flow=rotation, guards=guards)
    length, initial = 1.001 * end - start, {"y": 1.0}
    run = mi.simulate(system, duration=length, start=start, initial=initial, options=SHORT)
    return sorted(t for t in run.events["t"] if start < t < end + ERROR)


def margin(function: Function, sign: float) -> Callable[..., float]:
    return lambda mode, t, y, p: sign * function(t)


def rotation(mode, t, y, p):  # type: ignore[no-untyped-def]
    return 0.2 * y.y, -0.2 * y.x


SUITE = Suite(
    repository="https://gitlab.com/petsc/petsc",
    licence="BSD 2-clause",
    files=f"{FOLDER}, {TUTORIALS}/output, {TUTORIALS}/hybrid/output",
    cases=cases,
)
