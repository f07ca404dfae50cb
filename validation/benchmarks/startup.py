"""The first run after an installation and the start with a warm cache, each in a new process."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

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


def _seconds(arguments: list[str], place: str) -> float:
    """Run Python with numba's cache, and its results, in a folder; seconds of the process."""
    paths = {"PYTHONPATH": str(Path(__file__).parents[2]), "NUMBA_CACHE_DIR": place}
    # Bytecode is kept, as for any user.
    inherited = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    begin = time.perf_counter()
    subprocess.run(
        [sys.executable, *arguments],
        env={**inherited, **paths},
        cwd=place,
        capture_output=True,
        check=True,
    )
    return time.perf_counter() - begin


def startup(quick: bool) -> Iterator[Row]:
    """Whole processes: imports, compilation or loading, and a run of three periods."""
    with tempfile.TemporaryDirectory() as loops:
        filling = Spread.of([_seconds(["-m", "mems_impact.hybrid.precompilation"], loops)])
        yield Row(TOPIC, "all methods", "compilation of the loops", filling, "s")
        for method, target in FIRST.items():
            run = ["-c", RUN, method]
            first, warm, compiled = [], [], []
            for _ in range(1 if quick else 3):
                with tempfile.TemporaryDirectory() as place:
                    compiled.append(_seconds(run, place))
                    warm.append(_seconds(run, place))
                with tempfile.TemporaryDirectory() as place:
                    shutil.copytree(loops, place, dirs_exist_ok=True)
                    first.append(_seconds(run, place))
            yield Row(TOPIC, method, "first run of a system", Spread.of(first), "s", target)
            yield Row(TOPIC, method, "warm cache", Spread.of(warm), "s", WARM)
            yield Row(TOPIC, method, "first run, all compiled", Spread.of(compiled), "s")
    with tempfile.TemporaryDirectory() as place:
        for command in COMMANDS:
            call = ["-m", "mems_impact", *command.split()]
            _seconds(call, place)
            spread = Spread.of([_seconds(call, place) for _ in range(3)])
            yield Row(TOPIC, command.split()[0], "command, warm cache", spread, "s", COMMAND)
