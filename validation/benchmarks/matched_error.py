"""The compiled engine against heyoka at the same final error on the periodic orbit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from time import process_time

import numpy as np

from validation.benchmarks.contestants import (
    CASES,
    PERIODIC,
    heyoka,
    heyoka_batch,
    package,
)
from validation.benchmarks.timing import Row, in_turn, ratio, scaled

WITHIN, HORIZON = 1e-7, 100
ENDS = range(HORIZON - 4, HORIZON + 1)  # one end alone can be right by luck
TOLERANCES = [m * 10.0**-k for k in range(4, 13) for m in (1.0, 0.3)]
RATIOS = (1.0, 0.1, 0.01)  # atol/rtol
LENGTH = 500
WIDTHS = (4, 8)  # trajectories of a batch
TOLERANCE = 1e-9

State = np.ndarray


def final_error(go: Callable[[float], State], truth: list[State]) -> float:
    """The largest error of the final state over runs of 96 to 100 forcing periods."""
    return max(float(np.abs(go(n) - y).max()) for n, y in zip(ENDS, truth, strict=True))


def loosest(solver: Callable[[float], Callable[[float], State]], truth: list[State]) -> float:
    """The loosest tolerance that keeps the error, and whose tighter neighbours keep it too."""
    best = TOLERANCES[-1]
    for tolerance in reversed(TOLERANCES):
        if final_error(solver(tolerance), truth) > WITHIN:
            break
        best = tolerance
    return best


def _package(rtol: float, share: float) -> Callable[[float], State]:
    go = package(PERIODIC, rtol=rtol, atol=share * rtol)
    return lambda periods: go(periods).final.y


def against_heyoka(quick: bool) -> Iterator[Row]:
    """Both with break-away watched; heyoka once more without, as its best case."""
    topic = "heyoka, matched error"
    exact = heyoka(PERIODIC, 0.0)
    truth = [exact(n) for n in ENDS]
    found = {share: loosest(lambda tol, s=share: _package(tol, s), truth) for share in RATIOS}
    tol = loosest(lambda tolerance: heyoka(PERIODIC, tolerance), truth)
    bare = loosest(lambda tolerance: heyoka(PERIODIC, tolerance, False), truth)
    for case in CASES:
        names = {
            share: f"compiled, rtol {rtol:.0e}, atol/rtol {share:g}"
            for share, rtol in found.items()
        }
        rivals = {
            name: package(case, rtol=found[share], atol=share * found[share])
            for share, name in names.items()
        }
        watched, unwatched = f"heyoka, tol {tol:.0e}", f"heyoka, no break-away, tol {bare:.0e}"
        rivals |= {watched: heyoka(case, tol), unwatched: heyoka(case, bare, False)}
        rivals["heyoka, machine precision"] = heyoka(case, 0.0)
        jobs = {name: (lambda go=go: go(LENGTH)) for name, go in rivals.items()}
        seconds = in_turn(jobs, 5 if quick else 15)
        for name in rivals:
            yield Row(topic, case.name, name, scaled(seconds[name], 1e6 / LENGTH), "us")
        fastest = min(names.values(), key=lambda name: sum(seconds[name]))
        note = f"each at the loosest tolerance with error < {WITHIN:g} on the periodic orbit"
        yield Row(
            topic,
            case.name,
            "compiled / heyoka",
            ratio(seconds[fastest], seconds[watched]),
            "",
            "<= 2",
            note,
        )
        for rival in (unwatched, "heyoka, machine precision"):
            yield Row(
                topic, case.name, f"compiled / {rival}", ratio(seconds[fastest], seconds[rival])
            )


def against_batches(quick: bool) -> Iterator[Row]:
    """One trajectory of this package after another beside heyoka's batches, per trajectory."""
    topic = "heyoka, batches"
    jobs = {"dop853": package(PERIODIC, rtol=TOLERANCE, method="dop853")}
    jobs |= {f"heyoka, {n} at a time": heyoka_batch(PERIODIC, TOLERANCE, n) for n in WIDTHS}
    runs = {name: (lambda go=go: go(LENGTH)) for name, go in jobs.items()}
    seconds = in_turn(runs, 3 if quick else 9, process_time)
    for name, width in zip(jobs, (1, *WIDTHS), strict=True):
        each = scaled(seconds[name], 1e6 / LENGTH / width)
        yield Row(topic, PERIODIC.name, name, each, "us a period")
    note = "its transitions are callbacks in Python"
    for name, width in zip(list(jobs)[1:], WIDTHS, strict=True):
        faster = ratio(seconds[name], seconds["dop853"], 1.0 / width)
        yield Row(topic, PERIODIC.name, f"{name} / dop853", faster, "", ">= 1", note)
