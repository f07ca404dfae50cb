"""Independent runs on one, two and four threads."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack
from functools import cache, partial
from multiprocessing import get_context
from os import cpu_count
from typing import Any

import numpy as np
from numba import njit

from validation.benchmarks.contestants import CHAOTIC, PERIODIC, Case, package
from validation.benchmarks.timing import Row, in_turn, ratio, scaled

TOPIC = "threads"
TARGETS = {2: ">= 1.7", 4: ">= 3"}


@njit(nogil=True)
def _arithmetic(rounds: int) -> float:
    value = 0.5
    for _ in range(rounds):
        value = 3.9 * value * (1.0 - value)
    return value


@cache
def _prepared(case: Case) -> Any:
    return package(case)


def _run(case: Case, length: int) -> None:
    _prepared(case)(length)


def _each(pool: Executor, cases: list[Case], length: int) -> None:
    list(pool.map(partial(_run, length=length), cases))


def threads(quick: bool) -> Iterator[Row]:
    """16 runs at neighbouring amplitudes; workers get them one by one as they finish.

    The same runs in separate processes show what this machine gives to this code.
    """
    length, rounds = (200, 3) if quick else (1000, 9)
    yield from _ceiling(quick)
    for case in (PERIODIC, CHAOTIC):
        amplitudes = case.amplitude + np.linspace(0.0, 0.01, 16)
        cases = [Case(case.name, float(f), case.omega) for f in amplitudes]
        with ExitStack() as stack:
            pools: dict[tuple[str, int], Executor] = {}
            for n in (1, *TARGETS):
                pools["threads", n] = stack.enter_context(ThreadPoolExecutor(n))
                processes = ProcessPoolExecutor(n, get_context("spawn"))
                pools["processes", n] = stack.enter_context(processes)
            for pool in pools.values():
                _each(pool, cases, 1)  # compiled or loaded, and every process is up
            jobs = {
                f"{n} {kind}": partial(_each, pool, cases, length)
                for (kind, n), pool in pools.items()
            }
            seconds = in_turn(jobs, rounds)
        for workers, times in seconds.items():
            yield Row(TOPIC, case.name, f"{len(cases)} runs, {workers}", scaled(times, 1.0), "s")
        note = f"{cpu_count()} logical cores"
        for n, target in TARGETS.items():
            for kind in ("threads", "processes"):
                speedup = ratio(seconds[f"1 {kind}"], seconds[f"{n} {kind}"])
                goal = target if kind == "threads" else ""
                yield Row(TOPIC, case.name, f"speed-up on {n} {kind}", speedup, "", goal, note)


def _ceiling(quick: bool) -> Iterator[Row]:
    """What threads give plain arithmetic on this machine now, its other work included."""

    def job(workers: int) -> None:
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(_arithmetic, [10_000_000] * 16))

    jobs = {n: (lambda n=n: job(n)) for n in (1, *TARGETS)}
    seconds = in_turn({str(n): go for n, go in jobs.items()}, 3 if quick else 9)
    for n in TARGETS:
        speedup = ratio(seconds["1"], seconds[str(n)])
        yield Row(TOPIC, "ceiling: plain arithmetic", f"speed-up on {n} threads", speedup)
