"""Sine and cosine of compiled code against mpmath and the C library."""

import math
import os
import platform
import subprocess
import sys
from math import sin as sine

import mpmath
import numpy as np
import pytest
from numba import njit

from mems_impact.integrators.jit import trigonometry
from mems_impact.integrators.jit.closures import take_snapshot
from mems_impact.integrators.jit.numba_support import JIT


def both(x, c, s):
    for i in range(x.size):
        c[i] = math.cos(x[i])
        s[i] = sine(x[i])


def compiled(function):
    """Compile a function as flows are."""
    return njit(**JIT)(take_snapshot(function).frozen()[0])


@pytest.fixture(scope="module")
def compute():
    function = compiled(both)

    def values(x):
        c, s = np.empty_like(x), np.empty_like(x)
        function(x, c, s)
        return c, s

    return values


def units_off(values, x, exact):
    """Return the largest error, in units in the last place."""
    with mpmath.workprec(300):
        errors = []
        for value, at in zip(values.tolist(), x.tolist(), strict=True):
            reference = exact(mpmath.mpf(at))
            errors.append(abs(mpmath.mpf(value) - reference) / math.ulp(float(reference)))
        return float(max(errors))


@pytest.mark.slow
@pytest.mark.parametrize("largest", [0.5, 1.0, 10.0, 1e3, 1e6, 1e9])
def test_errors_are_below_one_unit_in_the_last_place(compute, largest):
    x = np.random.default_rng(1).uniform(-largest, largest, 1500)
    quarter = np.round(x[:500] * 2.0 / math.pi) * (math.pi / 2.0)  # the hardest arguments
    x = np.concatenate([x, quarter, np.nextafter(quarter, np.inf), np.nextafter(quarter, -np.inf)])
    x = x[np.abs(x) < trigonometry.LARGEST_ARGUMENT]
    c, s = compute(x)
    assert units_off(c, x, mpmath.cos) < 1.0
    assert units_off(s, x, mpmath.sin) < 1.0


def test_the_hardest_argument_of_a_binade(compute):
    x = np.array([45.553093477052, 2.0**29 * math.pi, 5e-324, 1e-160])
    c, s = compute(x)
    assert units_off(c, x, mpmath.cos) < 1.0
    assert units_off(s, x, mpmath.sin) < 1.0


def test_other_arguments_are_the_librarys(compute):
    x = np.array([0.0, -0.0, math.nan, 1e9, -3e15, 1e300])
    c, s = compute(x)
    assert c.tolist() == pytest.approx(np.cos(x).tolist(), abs=1e-16, nan_ok=True)
    assert s.tolist() == pytest.approx(np.sin(x).tolist(), abs=1e-16, nan_ok=True)
    assert math.copysign(1.0, s[1]) == -1.0


WITHOUT_FMA = """
import math
from numba import njit
from mems_impact.integrators.jit import trigonometry
from mems_impact.integrators.jit.closures import take_snapshot
from mems_impact.integrators.jit.numba_support import JIT

def cosine(x):
    return math.cos(x) + 0.0

assert not trigonometry.has_fma()
function = njit(**JIT)(take_snapshot(cosine).frozen()[0])
assert all(function(0.37 * i) == math.cos(0.37 * i) for i in range(1, 500))
"""


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="others have it always")
def test_without_fused_multiply_add_the_library_computes():
    settings = {**os.environ, "NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": ""}
    subprocess.run([sys.executable, "-c", WITHOUT_FMA], env=settings, check=True)


def test_a_function_of_ones_own_called_cos_stays():
    class own:
        @staticmethod
        def cos(x):
            return 2.0 * x

    cos = own.cos

    def twice(x):
        return cos(x) + math.cos(3)  # an integer, as Python takes it

    assert compiled(twice)(1.5) == 3.0 + math.cos(3)
