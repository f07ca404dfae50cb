"""A mutant on trial: a copy of the project, the fault in it, and the tests that should see it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from validation.mutation.mutants import Mutant
from validation.mutation.watched import Watched, where_seen
from validation.mutation.watching import LIMITS, WATCH_INTO

COPIED = ("mems_impact", "tests", "validation", "docs", "pyproject.toml", "README.md")

# The tests that are watched; and of a room, or a module, those that may run it unseen, compiled.
WATCHED = ("tests/hybrid", "tests/orbits", "tests/continuation", "tests/analysis", "tests/peers")
WATCHED += ("tests/campaign/test_regressions.py", "tests/campaign/test_families.py")
UNSEEN = {
    "hybrid": ("tests/hybrid/", "tests/campaign/", "tests/analysis/test_attractor.py"),
    "hybrid/variational/flow": ("tests/hybrid/test_variational.py", "tests/orbits/"),
    "hybrid/variational/saltation": ("tests/hybrid/test_variational.py", "tests/orbits/"),
    "orbits": ("tests/orbits/",),
    "continuation": ("tests/continuation/",),
}
BUDGET = 300.0  # seconds that the tests of one mutant took of the right source
PATIENCE, COMPILING = 3.0, 40.0  # times its seconds, and seconds on top, before a test hangs
WHOLE = 3600.0  # seconds on the wall of one process, which may wait for ever


def unseen(path: str) -> tuple[str, ...]:
    """Return where the tests of a module stand that may run it compiled, unseen."""
    module = path.removeprefix("mems_impact/").removesuffix(".py")
    return UNSEEN.get(module, UNSEEN[module.partition("/")[0]])


@dataclass(frozen=True)
class Copy:
    """A copy of the project for one worker, with a compile cache of its own."""

    root: Path

    @classmethod
    def make(cls, project: Path, root: Path) -> Copy:
        """Copy a project, over an older copy if there is one, whose compile cache is kept."""
        for name in COPIED:
            source, place = project / name, root / name
            if source.is_dir():
                shutil.rmtree(place, ignore_errors=True)
                ignored = shutil.ignore_patterns("__pycache__", "*.nbi", "*.nbc")
                shutil.copytree(source, place, ignore=ignored)
            elif source.exists():
                shutil.copy2(source, place)
        return cls(root)

    def watch(self, file: str, into: Path) -> None:
        """Watch the tests of a file; nothing is written if there is none."""
        self._run([file], {WATCH_INTO: str(into)})

    def passes(self, tests: list[str], limits: dict[str, float]) -> bool:
        """Run tests up to the first failure; one that takes longer than its file's limit failed."""
        place = self.root / "limits.json"
        place.write_text(json.dumps(limits), encoding="utf-8")
        return self._run(["-x", *tests], {LIMITS: str(place)}) == 0

    def _run(self, arguments: list[str], extra: dict[str, str]) -> int:
        command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider"]
        environment = {
            **os.environ,
            **extra,
            "PYTHONPATH": str(self.root),
            "PYTHONDONTWRITEBYTECODE": "1",
            "NUMBA_CACHE_DIR": str(self.root / "compiled"),
            "MPLBACKEND": "Agg",
        }
        process = subprocess.Popen(
            [*command, "-p", "validation.mutation.watching", *arguments],
            cwd=self.root,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            return process.wait(WHOLE)
        except subprocess.TimeoutExpired:
            return -1
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # with the processes that a test started
            process.wait()

    def survives(self, mutant: Mutant, watched: Watched) -> bool:
        """Return whether no test notices the mutant."""
        ran = watched.running(where_seen(self.root, mutant.path, mutant.line))
        tests = watched.in_turn(ran, unseen(mutant.path), BUDGET)
        place = self.root / mutant.path
        source, times = place.read_text(encoding="utf-8"), place.stat()
        place.write_text(mutant.applied(source), encoding="utf-8")
        try:
            return self.passes(tests, watched.limits(PATIENCE, COMPILING))
        finally:
            place.write_text(source, encoding="utf-8")
            # With its old time, what was compiled of the right source is still good.
            os.utime(place, ns=(times.st_atime_ns, times.st_mtime_ns))
