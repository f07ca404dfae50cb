"""The first run after an installation and the start with a warm cache, each in a new process."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from llvmlite import binding as llvm

from mems_impact.hybrid.precompilation import replace_code
from validation.benchmarks.timing import Row, Spread

TOPIC = "start"
RUN = """
import sys
import mems_impact as mi
drive = mi.Sine(amplitude=0.24, omega=0.5)
mi.simulate(mi.load_actuator("zhao2004"), drive, periods=3, options=mi.Options(method=sys.argv[1]))
"""
FIRST = {"adams": "<= 3", "bdf": "<= 3", "dop853": "<= 3", "auto": "<= 3.5"}
WARM, COMMAND = "<= 1", "<= 1.5"
COMMANDS = ("devices", "simulate zhao2004 --amplitude 0.24 --omega 0.5 --periods 20 --quiet")


def _seconds(arguments: list[str], place: str, **environment: str) -> float:
    """Run Python with numba's cache, and its results, in a folder; seconds of the process."""
    paths = {"PYTHONPATH": str(Path(__file__).parents[2]), "NUMBA_CACHE_DIR": place}
    # Bytecode is kept, as for any user.
    inherited = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    begin = time.perf_counter()
    subprocess.run(
        [sys.executable, *arguments],
        env={**inherited, **paths, **environment},
        cwd=place,
        capture_output=True,
        check=True,
    )
    return time.perf_counter() - begin


def startup(quick: bool) -> Iterator[Row]:
    """Whole processes: imports, compilation or loading, and a run of three periods."""
    begin = time.perf_counter()
    replace_code(distribute=False)
    installing = Spread.of([time.perf_counter() - begin])
    yield Row(TOPIC, "all methods", "compilation by an editable install", installing, "s")
    # With a prescribed processor the machine code of the installation is not used.
    without = {"NUMBA_CPU_NAME": llvm.get_host_cpu_name()}
    for method, target in FIRST.items():
        run = ["-c", RUN, method]
        first, warm, compiled = [], [], []
        for _ in range(1 if quick else 3):
            with tempfile.TemporaryDirectory() as place:
                first.append(_seconds(run, place))
                warm.append(_seconds(run, place))
            with tempfile.TemporaryDirectory() as place:
                compiled.append(_seconds(run, place, **without))
        yield Row(TOPIC, method, "first run of an installation", Spread.of(first), "s", target)
        yield Row(TOPIC, method, "warm cache", Spread.of(warm), "s", WARM)
        yield Row(TOPIC, method, "first run, all compiled", Spread.of(compiled), "s")
    with tempfile.TemporaryDirectory() as place:
        for command in COMMANDS:
            call = ["-m", "mems_impact", *command.split()]
            _seconds(call, place)
            spread = Spread.of([_seconds(call, place) for _ in range(3)])
            yield Row(TOPIC, command.split()[0], "command, warm cache", spread, "s", COMMAND)
