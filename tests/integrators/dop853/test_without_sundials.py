"""The one-step method is compiled wherever numba is, with or without SUNDIALS."""

import subprocess
import sys
import textwrap
import warnings
from pathlib import Path

import numpy as np
import pytest

from mems_impact.errors import EngineFallbackWarning, EngineUnavailable
from mems_impact.integrators.availability import available_options, is_compiled
from mems_impact.integrators.cvode import compiled as library
from mems_impact.integrators.options import METHODS, Options
from tests.hybrid.systems import BALL, ball, simulate


@pytest.fixture
def no_sundials(monkeypatch):
    def load():
        raise EngineUnavailable("SUNDIALS is of version 9", library.LIBRARY_REMEDY)

    monkeypatch.setattr(library, "load", load)


@pytest.mark.usefixtures("no_sundials")
def test_it_is_compiled_where_sundials_cannot_be_bound():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for engine in ("auto", "compiled"):
            run = simulate(BALL, ball(0.5), [1.0, 0.0], 0.5, engine=engine, method="dop853")
            alone = simulate(BALL, ball(0.5), [1.0, 0.0], 0.5, engine=engine, method="auto")
            assert np.array_equal(run.final.y, alone.final.y)
    with pytest.warns(EngineFallbackWarning):
        compiled = {m: is_compiled(available_options(Options(method=m))) for m in METHODS}
    assert compiled == {"adams": True, "bdf": False, "dop853": True, "auto": True}


@pytest.mark.usefixtures("no_sundials")
def test_the_fallback_names_it():
    with pytest.warns(EngineFallbackWarning, match="method 'dop853' replaces 'adams'"):
        simulate(BALL, ball(0.5), [1.0, 0.0], 0.1, engine="auto")


WITHOUT = """
    import sys
    sys.modules["sksundae"] = None  # as if it were not installed
    sys.path.insert(0, {root!r})
    from tests.hybrid.systems import BALL, ball, simulate
    for engine in ("compiled", "interpreted"):
        run = simulate(BALL, ball(0.5), [1.0, 0.0], 0.7, engine=engine, method="dop853")
        print(len(run.events), run.final.mode)
"""


@pytest.mark.slow
def test_it_needs_no_scikit_sundae():
    code = textwrap.dedent(WITHOUT).format(root=str(Path(__file__).parents[3]))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    assert first == second
