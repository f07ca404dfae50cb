"""A plugin of pytest: what each test runs of the numerics and how long it takes, or an end to it.

With WATCH_INTO, a file, every test is watched, and what was seen is written there. With LIMITS, a
file of seconds by test file, a test that takes longer ends the process: nothing else ends a
compiled loop that goes on for ever.
"""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from validation.mutation.mutants import ROOMS

WATCH_INTO, LIMITS = "MUTATION_WATCH_INTO", "MUTATION_LIMITS"
LONGEST = 60.0  # seconds that a test may take to be of use here
# All seconds are those of the processor: a busy machine kills no mutant.


def pytest_configure(config: pytest.Config) -> None:
    if WATCH_INTO in os.environ:
        config.pluginmanager.register(Watch(Path(os.environ[WATCH_INTO]), config.rootpath))
    if LIMITS in os.environ:
        config.pluginmanager.register(Limits(Path(os.environ[LIMITS])))


class Watch:
    """Lines and seconds of every test that passes."""

    def __init__(self, into: Path, root: Path) -> None:
        import coverage  # here, since a trial needs none

        self.into, self.root = into, root
        self.seconds: dict[str, float] = {}
        self.passed: set[str] = set()
        rooms = [f"{root}/mems_impact/{room}/*" for room in ROOMS]
        self.coverage = coverage.Coverage(data_file=None, config_file=False, include=rooms)
        self.coverage.start()
        signal.signal(signal.SIGPROF, _too_long)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        self.coverage.switch_context(item.nodeid)
        signal.setitimer(signal.ITIMER_PROF, LONGEST)
        began = time.process_time()
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            self.seconds[item.nodeid] = time.process_time() - began
            self.coverage.switch_context("")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" and report.passed:
            self.passed.add(report.nodeid)
        elif report.failed:
            self.passed.discard(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        self.coverage.stop()
        data = self.coverage.get_data()
        lines: dict[str, dict[int, list[str]]] = {}
        for place in data.measured_files():
            path = Path(place).relative_to(self.root).as_posix()
            tests = data.contexts_by_lineno(place).items()
            lines[path] = {line: sorted(self.passed & set(ran)) for line, ran in tests}
        # In the order in which they ran, which is that of their files.
        seconds = {test: taken for test, taken in self.seconds.items() if test in self.passed}
        left_out = [test for test in self.seconds if test not in self.passed]
        told = {"seconds": seconds, "left_out": left_out, "lines": lines}
        self.into.write_text(json.dumps(told), encoding="utf-8")


def _too_long(*_: Any) -> None:
    raise TimeoutError(f"longer than {LONGEST} s")


class Limits:
    """The end of a process in which a test hangs."""

    def __init__(self, place: Path) -> None:
        self.limits: dict[str, float] = json.loads(place.read_text(encoding="utf-8"))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        signal.setitimer(signal.ITIMER_PROF, self.limits[item.nodeid.partition("::")[0]])
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
