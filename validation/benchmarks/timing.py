"""Timing in turn (A B A B …), and ratios with their spread."""

from __future__ import annotations

import gc
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("mems_impact", "numpy", "numba", "scikit-sundae", "scipy", "heyoka")


@dataclass(frozen=True)
class Spread:
    """Median and extremes of repeated measurements."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: list[float]) -> Spread:
        return cls(statistics.median(values), min(values), max(values))

    def __str__(self) -> str:
        return f"{self.median:.3g} ({self.low:.3g} to {self.high:.3g})"


@dataclass(frozen=True)
class Row:
    """One line of the report.

    `target` reads like ``">= 25"`` or ``"<= 2"``; empty where there is none.
    """

    topic: str
    case: str
    quantity: str
    value: Spread
    unit: str = ""
    target: str = ""
    note: str = ""

    @property
    def met(self) -> str:
        """Whether the median meets the target."""
        if not self.target:
            return ""
        relation, bound = self.target.split()
        value = self.value.median
        good = value >= float(bound) if relation == ">=" else value <= float(bound)
        return "yes" if good else "NO"


def in_turn(
    jobs: Mapping[str, Callable[[], object]],
    rounds: int,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, list[float]]:
    """Time every job once a round, so that a slow spell of the machine hits all of them.

    Each job is run once before, untimed, so that whatever compiles has compiled. With
    ``time.process_time`` for a clock other processes do not count, nor does waiting.
    """
    for job in jobs.values():
        job()
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            gc.collect()
            begin = clock()
            job()
            seconds[name].append(clock() - begin)
    return seconds


def ratio(slow: list[float], fast: list[float], scale: float = 1.0) -> Spread:
    """How many times as long `slow` took, round by round; `scale` corrects unequal work."""
    return Spread.of([scale * a / b for a, b in zip(slow, fast, strict=True)])


def scaled(seconds: list[float], factor: float) -> Spread:
    """Seconds times `factor`, as a spread."""
    return Spread.of([value * factor for value in seconds])


def machine() -> dict[str, str]:
    """What the figures were measured on."""
    model = platform.processor() or platform.machine()
    cores = 0
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text().splitlines()
        cores = sum(line.startswith("processor") for line in lines)
        names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
        model = names[0] if names else model
    described = {"processor": model, "cores": str(cores), "system": platform.platform()}
    described |= {"load at the start": load(), "Python": platform.python_version()}
    return described | {package: version(package) for package in PACKAGES}


def load() -> str:
    """The processes that run or wait for a core, on average over a minute."""
    return f"{os.getloadavg()[0]:.2f}" if hasattr(os, "getloadavg") else "unknown"
