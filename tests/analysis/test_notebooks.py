"""Functions from a cell, a script, another function: they run compiled, and are kept on disk."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = """
    import ctypes
    import logging
    import math
    import mems_impact as mi

    logging.basicConfig(level=logging.INFO)
    CELL = '''
    LEVEL = -1.0

    def height(mode, t, y, p):
        return y.x - LEVEL

    def bounce(mode, t, y, p):
        return mode, (LEVEL, -p.e * y.v)
    '''

    def fall(mode, t, y, p):
        return y.v, -p.g

    def lower(level):
        return lambda mode, t, y, p: y.x - level, lambda mode, t, y, p: (mode, (level, -p.e * y.v))

    fabs = ctypes.CDLL(None).fabs
    fabs.argtypes, fabs.restype = [ctypes.c_double], ctypes.c_double

    def in_c(mode, t, y, p):
        return y.v, -fabs(p.g)

    def first_impact(flow, gap, rebound):
        guards = [mi.Impact("floor", gap, rebound)]
        values = {"g": 2.0, "e": 0.5}
        ball = mi.System(states=("x", "v"), flow=flow, parameters=values, guards=guards)
        options = mi.Options(engine="compiled", method="dop853")
        return mi.simulate(ball, duration=1.5, options=options).impacts["t"].round(9).tolist()

    import textwrap
    cell = {"__name__": "__main__"}
    exec(compile(textwrap.dedent(CELL), "<ipython-input-7-c0ffee>", "exec"), cell)
"""
KEPT = """
    print(first_impact(fall, cell["height"], cell["bounce"]))
    print(first_impact(fall, *lower(-1.0)))
"""
UNKEPT = """
    print(first_impact(in_c, *lower(-1.0)))
"""
NOTICE = "compiling the functions of a system"
NOT_KEPT = "the compiled code of this system is not kept"


def go(folder, script):
    (folder / "script.py").write_text(textwrap.dedent(script))
    paths = {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(folder / "compiled")}
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=folder, env={**os.environ, **paths},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.split("\n")[:-1], done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a cache of its own."""
    return tmp_path_factory.mktemp("notebook")


@pytest.mark.nightly
def test_functions_from_anywhere_run_compiled_and_say_where_they_are_not_kept(folder):
    found, said = go(folder, SCRIPT + KEPT)
    assert found == ["[1.0]"] * 2
    assert NOTICE in said
    assert NOT_KEPT not in said
    found, said = go(folder, SCRIPT + KEPT)  # all of it from disk
    assert found == ["[1.0]"] * 2
    assert NOTICE not in said


@pytest.mark.nightly
def test_a_function_that_draws_on_an_object_says_that_it_is_not_kept(folder):
    found, said = go(folder, SCRIPT + UNKEPT)
    assert found == ["[1.0]"]
    assert f"{NOT_KEPT}: its functions depend on objects that differ" in said
    assert "(_FuncPtr)" in said
