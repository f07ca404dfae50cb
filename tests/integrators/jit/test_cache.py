"""Compiled code on disk: found again, never stale, and no trouble where it is broken."""

import io
import logging
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from numba import types

from mems_impact.integrators.jit import machine_code, numba_support

ROOT = Path(__file__).parents[3]
NOTICE = numba_support.SYSTEM_NOTICE

SYSTEM = """
    import os
    import constants
    from constants import RATE

    GAIN = float(os.environ.get("GAIN", "1"))

    def flow(mode, t, y, p, dy):
        dy[0] = RATE
        dy[1] = constants.RATE
        dy[2] = GAIN

    def margins(mode, t, y, p, g, r):
        g[0] = 1.0

    def transition(mode, code, t, y, p):
        return mode
"""
RUN = """
    import logging
    import numpy as np
    import system
    from mems_impact.integrators.options import Options
    from mems_impact.hybrid.automaton import Automaton, Guard
    from mems_impact.hybrid.problem import Problem
    from mems_impact.hybrid.simulation import run
    from mems_impact.hybrid.state import HybridState

    logging.basicConfig(level=logging.INFO)
    ramps = Automaton(
        states=("a", "b", "c"), modes=("m",), guards=(Guard(name="never", order=0),),
        flow=system.flow, margins=system.margins, transition=system.transition,
    )
    problem = Problem(
        automaton=ramps, parameters=[0.0], period=1.0, options=Options(engine="compiled")
    )
    print(*run(problem, HybridState(0, 0.0, 0, np.zeros(3)), 1.0).final.y.round(6))
"""


class Folder:
    """A folder with a system and a cache of its own; every run is a fresh process."""

    def __init__(self, path):
        self.path, self.compiled = path, path / "compiled"
        self.write("system.py", SYSTEM)
        self.write("go.py", RUN)
        self.write("constants.py", "RATE = 1.0")

    def write(self, name, text):
        (self.path / name).write_text(textwrap.dedent(text))

    def go(self, **environment):
        """What a run prints, and whether it compiled anything."""
        paths = {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(self.compiled)}
        done = subprocess.run(
            [sys.executable, "go.py"],
            cwd=self.path,
            env={**os.environ, **paths, **environment},
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.split(), NOTICE in done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = Folder(tmp_path_factory.mktemp("system"))
    assert made.go() == (["1.0", "1.0", "1.0"], True)
    return made


@pytest.mark.slow
def test_compiled_code_is_found_again(folder):
    assert folder.go() == (["1.0", "1.0", "1.0"], False)


@pytest.mark.nightly
def test_a_number_in_another_file_or_from_the_environment(folder):
    folder.write("constants.py", "RATE = 5.0  # edited")
    assert folder.go(GAIN="7") == (["5.0", "5.0", "7.0"], True)
    folder.write("constants.py", "RATE = 1.0")
    assert folder.go() == (["1.0", "1.0", "1.0"], False)


@pytest.mark.slow
def test_a_broken_file_is_replaced(folder):
    for share in (0.5, 0.0):  # cut short, and empty
        files = list(folder.compiled.rglob("flow_kernel*.code"))
        assert files
        for file in files:
            file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
        assert folder.go() == (["1.0", "1.0", "1.0"], True)
    assert folder.go() == (["1.0", "1.0", "1.0"], False)


@pytest.mark.nightly
def test_an_edit_keeps_the_code_of_other_functions(folder):
    def kept(role):
        return {file.name for file in folder.compiled.rglob(f"{role}_kernel*.code")}

    before = {role: kept(role) for role in ("flow", "margins", "transition")}
    folder.write("system.py", SYSTEM.replace("return mode", "return mode + 0"))
    assert folder.go() == (["1.0", "1.0", "1.0"], True)
    assert kept("flow") == before["flow"]
    assert kept("margins") == before["margins"]
    assert len(kept("transition")) == len(before["transition"]) + 1
    folder.write("system.py", SYSTEM)
    assert folder.go() == (["1.0", "1.0", "1.0"], False)


def _double(x):
    return 2.0 * x


def compiled():
    done = numba_support.compile_callback(_double, types.float64(types.float64), "of a test")
    return done.ctypes(3.0)


def test_no_directory_can_be_written(monkeypatch):
    monkeypatch.setattr(machine_code, "cache_directory", lambda: None)
    assert compiled() == 6.0


def test_the_disk_is_full(monkeypatch, caplog):
    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(machine_code, "read", lambda *_: None)
    monkeypatch.setattr(machine_code, "write", refuse)
    with caplog.at_level(logging.INFO, "mems_impact"):
        assert compiled() == 6.0
    assert "No space left" in caplog.text


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def unannounced():
    numba_support.announce.cache_clear()
    yield
    numba_support.announce.cache_clear()


@pytest.mark.usefixtures("unannounced")
def test_a_terminal_is_reported_once(monkeypatch, caplog):
    monkeypatch.setattr(sys, "stderr", Terminal())
    numba_support.announce(NOTICE)
    numba_support.announce(NOTICE)
    assert sys.stderr.getvalue().count(NOTICE) == 1
    assert sys.stderr.getvalue().count("\n") == 1
    assert not caplog.records


@pytest.mark.usefixtures("unannounced")
def test_elsewhere_the_log_is(monkeypatch, caplog):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with caplog.at_level(logging.INFO, "mems_impact"):
        numba_support.announce(NOTICE)
    assert NOTICE in caplog.text
    assert sys.stderr.getvalue() == ""


WITHOUT_COMPILER = """
    import math, warnings
    import mems_impact as mi

    def cosine(t, q):
        return q[0] * math.cos(t)

    drive = mi.Custom(function=cosine, period=2 * math.pi, values={"height": 0.2})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        print(mi.simulate(mi.load_actuator("zhao2004"), drive, 1).final.x2)
    assert {w.category for w in caught} == {mi.EngineFallbackWarning}, caught
    assert "NUMBA_DISABLE_JIT" in str(caught[0].message)
"""


@pytest.mark.slow
def test_with_numba_switched_off_the_interpreted_engine_takes_over():
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(WITHOUT_COMPILER)],
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert np.isfinite(float(done.stdout))
