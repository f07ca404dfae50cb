"""Independent runs on one, two and four threads."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count

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


def threads(quick: bool) -> Iterator[Row]:
    """16 runs at neighbouring amplitudes; threads get them one by one as they finish."""
    length = 200 if quick else 1000
    yield from _ceiling(quick)
    for case in (PERIODIC, CHAOTIC):
        amplitudes = case.amplitude + np.linspace(0.0, 0.01, 16)
        runs = [package(Case(case.name, float(f), case.omega)) for f in amplitudes]

        def job(workers: int, runs=runs) -> None:  # type: ignore[no-untyped-def]
            with ThreadPoolExecutor(workers) as pool:
                list(pool.map(lambda go: go(length), runs))

        jobs = {str(n): (lambda n=n: job(n)) for n in (1, *TARGETS)}
        seconds = in_turn(jobs, 3 if quick else 9)
        for n, times in seconds.items():
            yield Row(TOPIC, case.name, f"{len(runs)} runs, {n} threads", scaled(times, 1.0), "s")
        note = f"{cpu_count()} logical cores"
        for n, target in TARGETS.items():
            speedup = ratio(seconds["1"], seconds[str(n)])
            yield Row(TOPIC, case.name, f"speed-up on {n} threads", speedup, "", target, note)


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
