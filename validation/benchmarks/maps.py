"""Operating maps: beside a plain loop over `simulate`, and on two workers of each kind."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import ExitStack
from functools import partial
from multiprocessing import get_context
from os import cpu_count
from typing import Any

import numpy as np
from dask.distributed import Client, LocalCluster

import mems_impact as mi
from validation.benchmarks.timing import Row, Spread, in_turn, ratio, scaled

TOPIC = "maps"
CASE = "f 0.16 to 0.30, omega 0.44 to 0.51"
TRANSIENT, PERIODS = 300, 60  # forcing periods of a point in the loop: those of `sweep`
OPTIONS = mi.Options(method="auto")  # of maps by default
EQUAL = mi.RecurrenceOptions(
    periods=PERIODS, exponents="none"
)  # as the loop, which has none either
BRIEF = mi.RecurrenceOptions(chaos_persistence=1)
FASTER, POINTS, SHARE = 3, 250, 0.975
WORKERS = 2


def _axes(size: int) -> dict[str, Any]:
    return {
        "x": ("amplitude", np.linspace(0.16, 0.30, size)),
        "y": ("omega", np.linspace(0.44, 0.51, size)),
    }


RECURRENCE = mi.RecurrenceOptions()


def _map(size: int, recurrence: mi.RecurrenceOptions = RECURRENCE, **given: Any) -> mi.OperatingMap:
    actuator = mi.load_actuator("zhao2004")
    drive = mi.Sine(amplitude=0.2, omega=0.5)
    start = mi.kicked_state(actuator)
    return mi.operating_map(
        actuator,
        drive,
        **_axes(size),
        initial=start,
        recurrence=recurrence,
        options=OPTIONS,
        **given,
    )


def _loop(size: int) -> None:
    """What one writes without studies: every point for a fixed time, and then its statistics."""
    actuator = mi.load_actuator("zhao2004")
    start = mi.kicked_state(actuator)
    axes = _axes(size)
    end = TRANSIENT + PERIODS
    for omega in axes["y"][1]:
        for amplitude in axes["x"][1]:
            drive = mi.Sine(amplitude=float(amplitude), omega=float(omega))
            run = mi.simulate(
                actuator, drive, periods=end, window=(float(TRANSIENT), float(end)),
                initial=start, options=OPTIONS, keep="statistics",
            )  # fmt: skip
            _ = run.statistics


def maps(quick: bool) -> Iterator[Row]:
    """The map that the documentation shows, on a coarser grid."""
    yield from _beside_a_loop(*((8, 3) if quick else (16, 7)))
    yield from _on_workers(*((16, 3) if quick else (24, 5)))


def _beside_a_loop(size: int, rounds: int) -> Iterator[Row]:
    """CPU seconds on one core."""
    jobs: dict[str, Callable[[], object]] = {
        "map": partial(_map, size, EQUAL, workers=1),
        "map with exponents": partial(_map, size, BRIEF, workers=1),
        "map with exponents, chaos followed further": partial(_map, size, workers=1),
        "plain loop": partial(_loop, size),
    }
    seconds = in_turn(jobs, rounds, time.process_time)
    points = size * size
    for name, times in seconds.items():
        each = Spread.of([points / value for value in times])
        yield Row(TOPIC, CASE, f"{name}, {points} points", each, "points/s and core")
    faster = ratio(seconds["plain loop"], seconds["map"])
    note = f"the loop: {TRANSIENT} periods of transient, {PERIODS} measured"
    yield Row(TOPIC, CASE, "map against the loop", faster, "", f">= {FASTER}", note)
    followed = float(_map(size, EQUAL, workers=1).table["returns"].sum())
    worth = Spread.of([followed / TRANSIENT / value for value in seconds["map"]])
    unit = f"points of {TRANSIENT} periods/s and core"
    note = f"{followed / points:.0f} periods a point"
    yield Row(TOPIC, CASE, "map, by periods followed", worth, unit, f">= {POINTS}", note)


def _alone(_: int, size: int) -> None:
    _map(size, workers=1)


def _separately(pool: Executor, size: int) -> None:
    """The whole map in each of two processes at once: as much as this machine gives."""
    list(pool.map(partial(_alone, size=size), range(WORKERS)))


def _on_workers(size: int, rounds: int) -> Iterator[Row]:
    """The same map by two workers of each kind, and by one thread.

    Two processes that know nothing of each other, each with the whole map, tell what two workers
    can reach on this machine just then.
    """
    with ExitStack() as stack:
        context = get_context("spawn")
        separate = stack.enter_context(ProcessPoolExecutor(WORKERS, context))
        processes = stack.enter_context(ProcessPoolExecutor(WORKERS, context))
        cluster = stack.enter_context(
            LocalCluster(n_workers=WORKERS, threads_per_worker=1, dashboard_address=None)
        )
        dask = stack.enter_context(Client(cluster)).get_executor()
        kinds: dict[str, Callable[[], object]] = {
            "threads": partial(_map, size, workers=WORKERS),
            "processes": partial(_map, size, executor=processes),
            "Dask workers": partial(_map, size, executor=dask),
        }
        jobs = {
            "1 thread": partial(_map, size, workers=1),
            "separate": partial(_separately, separate, size),
            **{f"{WORKERS} {kind}": job for kind, job in kinds.items()},
        }
        seconds = in_turn(jobs, rounds)
    points = size * size
    for name, times in seconds.items():
        if name != "separate":
            yield Row(TOPIC, CASE, f"{points} points, {name}", scaled(times, 1.0), "s")
    note = f"{cpu_count()} logical cores"
    one = seconds["1 thread"]
    reached = ratio(one, seconds["separate"], WORKERS)
    yield Row(TOPIC, CASE, f"speed-up on {WORKERS} separate processes", reached, "", "", note)
    for kind in kinds:
        times = seconds[f"{WORKERS} {kind}"]
        yield Row(TOPIC, CASE, f"speed-up on {WORKERS} {kind}", ratio(one, times), "", "", note)
        share = ratio(seconds["separate"], times, 1.0 / WORKERS)
        quantity = f"{WORKERS} {kind} against separate processes"
        yield Row(TOPIC, CASE, quantity, share, "", f">= {SHARE}")
