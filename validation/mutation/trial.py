"""A mutant on trial: a copy of the project, the fault in it, and the tests that should see it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from validation.mutation.mutants import Mutant

COPIED = ("mems_impact", "tests", "validation", "docs", "pyproject.toml", "README.md")

HYBRID = ["closed_forms", "odd_automata", "events", "switches", "samples", "scan"]
HYBRID += ["record", "hidden", "sequences", "agreement", "long_runs"]
RUNS = [f"tests/hybrid/test_{name}.py" for name in HYBRID]
RUNS += ["tests/campaign/test_stories.py", "tests/campaign/test_families.py"]
ORBITS = ["audit", "linear_oscillator", "find_orbit", "stickslip"]
ORBITS = [f"tests/orbits/test_{name}.py" for name in ORBITS]
BRANCHES = ["linear_oscillator", "branches", "doubling", "neimark_sacker", "grazing_type"]
BRANCHES = [f"tests/continuation/test_{name}.py" for name in BRANCHES]

# Tests of a module, those that tell soonest first; of a room, where the module has none of its own.
TESTS: dict[str, list[str]] = {
    "hybrid": RUNS,
    "hybrid/written": ["tests/analysis/test_system.py", *RUNS],
    "hybrid/variational": ["tests/hybrid/test_variational.py", *ORBITS],
    "hybrid/columns": ["tests/hybrid/test_variational.py", *ORBITS],
    "hybrid/passage": ["tests/hybrid/test_variational.py", *ORBITS],
    "orbits": [*ORBITS, *BRANCHES[:2]],
    "continuation": BRANCHES,
    "continuation/conditions": ["tests/continuation/test_conditions.py", *BRANCHES],
    "continuation/curve": ["tests/continuation/test_curves.py", *BRANCHES],
    "continuation/grazing": ["tests/continuation/test_grazing_type.py", *BRANCHES],
}
NONE_CHOSEN = 5  # pytest's exit status

ROOMS = ("hybrid", "orbits", "continuation")


def files_for(path: str) -> list[str]:
    """Return the test files for a module of the package."""
    module = path.removeprefix("mems_impact/").removesuffix(".py")
    return TESTS.get(module, TESTS[module.partition("/")[0]])


@dataclass(frozen=True)
class Copy:
    """A copy of the project for one worker, with a compile cache of its own."""

    root: Path

    @classmethod
    def make(cls, project: Path, root: Path) -> Copy:
        for name in COPIED:
            source = project / name
            if source.is_dir():
                ignored = shutil.ignore_patterns("__pycache__", "*.nbi", "*.nbc")
                shutil.copytree(source, root / name, ignore=ignored)
            elif source.exists():
                shutil.copy2(source, root / name)
        return cls(root)

    def passes(self, tests: list[str], limit: float, chosen: str = "") -> bool:
        """Run tests up to the first failure; one that takes longer than `limit` seconds failed.

        `chosen` is pytest's ``-k``; that it chooses none is no failure.
        """
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider"]
        status = self._run([*command, "-k", chosen, *tests], limit)
        return status == 0 or (status == NONE_CHOSEN and chosen != "")

    def notices(self, tests: list[str], limit: float) -> bool:
        """Return whether a test fails, those on the interpreted engine first.

        They need no compiling, and of most mutants of the event loop they are the end.
        """
        began = time.monotonic()
        if not self.passes(tests, limit, "interpreted"):
            return True
        return not self.passes(tests, limit - (time.monotonic() - began))

    def _run(self, command: list[str], limit: float) -> int:
        environment = {
            **os.environ,
            "PYTHONPATH": str(self.root),
            "PYTHONDONTWRITEBYTECODE": "1",
            "NUMBA_CACHE_DIR": str(self.root / "compiled"),
            "MPLBACKEND": "Agg",
        }
        process = subprocess.Popen(
            command,
            cwd=self.root,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            return process.wait(max(limit, 1.0))
        except subprocess.TimeoutExpired:
            return -1
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)  # with the processes that a test started
                process.wait()

    def survives(self, mutant: Mutant, limit: float) -> bool:
        """Return whether no test notices the mutant."""
        place = self.root / mutant.path
        source, times = place.read_text(encoding="utf-8"), place.stat()
        place.write_text(mutant.applied(source), encoding="utf-8")
        try:
            return not self.notices(files_for(mutant.path), limit)
        finally:
            place.write_text(source, encoding="utf-8")
            # With its old time, what was compiled of the right source is still good.
            os.utime(place, ns=(times.st_atime_ns, times.st_mtime_ns))
