"""One function of a system is edited, and the system runs again in the same process."""

from __future__ import annotations

import itertools
import time
from collections import namedtuple
from collections.abc import Callable, Iterator

import numba

import mems_impact as mi
from validation.benchmarks.timing import Row, in_turn, ratio, scaled

PERIODS = 30
SYSTEM = """
import math
import mems_impact as mi

def flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - p.k * y.x - p.c * y.v

def gap(mode, t, y, p):
    return p.d - y.x

def rebound(mode, t, y, p):
    return mode, (p.d, -p.e * y.v)

system = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"c": 0.1, "k": 1.0, "d": 1.0, "e": 0.8, "A": 0.6, "omega": 0.8},
    guards=[mi.Impact("stop", gap, rebound)],
)
"""
# The factor of a term of each function, which every edit changes by less than a run can show.
TERMS = {"flow": "- p.c", "gap": "return p.d", "rebound": "-p.e"}

State = namedtuple("State", "x v")
Parameters = namedtuple("Parameters", "c k d e A omega")
ARGUMENTS = (
    numba.types.int64,
    numba.types.float64,
    numba.typeof(State(0.0, 0.0)),
    numba.typeof(Parameters(*[0.0] * 6)),
)

_edits = itertools.count(1)


def edited(name: str) -> dict[str, object]:
    """Return the names of SYSTEM with a function `name` that no process has compiled."""
    factor = 1.0 + 1e-12 * next(_edits) + 1e-15 * (time.time_ns() % 1000)
    names: dict[str, object] = {}
    exec(SYSTEM.replace(TERMS[name], f"{TERMS[name]} * {factor!r}"), names)
    return names


def runs(name: str) -> Callable[[], object]:
    """Return a job: edit a function of the system, and run it."""
    options = mi.Options(method="dop853")
    return lambda: mi.simulate(edited(name)["system"], periods=PERIODS, options=options)


def by_numba(name: str) -> Callable[[], object]:
    """Return a job: edit a function, and compile it by numba alone, without a run."""
    return lambda: numba.njit([ARGUMENTS])(edited(name)[name])


def edits(quick: bool) -> Iterator[Row]:
    jobs = {f"{name}, run": runs(name) for name in TERMS}
    jobs |= {f"{name}, numba": by_numba(name) for name in TERMS}
    seconds = in_turn(jobs, 3 if quick else 15, time.process_time)
    for name in TERMS:
        run, alone = seconds[f"{name}, run"], seconds[f"{name}, numba"]
        case = f"own system, {name} edited"
        yield Row("edits", case, "edit and run", scaled(run, 1.0), "s", "<= 0.4")
        yield Row(
            "edits", case, "beside numba's compilation of it alone", ratio(run, alone), "", ""
        )
