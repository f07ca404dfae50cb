"""The first compilation and the start with a warm cache, each in a process of its own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator

from validation.benchmarks.timing import Row, Spread

PROGRAM = """
import time
begin = time.perf_counter()
from validation.benchmarks.contestants import PERIODIC, package
go = package(PERIODIC, section=True)
imported = time.perf_counter()
go(1)
first = time.perf_counter()
go(1)
second = time.perf_counter()
print("imports", imported - begin)
print("compile", (first - imported) - (second - first))
"""


def _start(cache: str) -> dict[str, float]:
    """Run PROGRAM with numba's cache in `cache`; seconds by name."""
    begin = time.perf_counter()
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    seconds = {name: float(value) for name, value in re.findall(r"(\w+) (\S+)", done.stdout)}
    return seconds | {"process": time.perf_counter() - begin}


def startup(quick: bool) -> Iterator[Row]:
    """Imports of the rivals weigh on "whole process" only, cold and warm alike."""
    cold, warm = [], []
    for _ in range(1 if quick else 3):
        with tempfile.TemporaryDirectory() as cache:
            cold.append(_start(cache))
            warm.append(_start(cache))
    topic, case = "start", "actuator, sine drive"
    for name, runs, target in (("empty cache", cold, "<= 5"), ("warm cache", warm, "")):
        spread = {key: Spread.of([run[key] for run in runs]) for key in runs[0]}
        yield Row(topic, case, f"compile or load, {name}", spread["compile"], "s", target)
        yield Row(topic, case, f"whole process, {name}", spread["process"], "s")
