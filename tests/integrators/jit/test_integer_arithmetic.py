"""Arithmetic of integers in compiled functions against that of Python."""

import pytest
from numba import njit

from mems_impact.integrators.jit.closures import take_snapshot
from mems_impact.integrators.jit.numba_support import JIT

TURNS = 4
EXPONENT = -3


def by_constant(n):
    return 10**EXPONENT + TURNS**-2 + n


def by_argument(n):
    return 10**n


def of_argument(n):
    return n**-1


def alternating(n):
    total = 0.0
    for k in range(-3, 4):
        total += (-1) ** k * 2**-k
    return total + n


def by_name(n):
    return pow(3, n)


def in_place(n):
    x = 5
    x **= n
    return x


LIGHT_SPEED = 299792458


def beyond_64_bits(n):
    cubed = LIGHT_SPEED**3 + n
    return -LIGHT_SPEED * LIGHT_SPEED * LIGHT_SPEED * n + 2 * cubed + LIGHT_SPEED**2 // 7


def squares(n):
    return (0.5, 1.5, 2.5, 3.5, 4.5)[n**2] + (0.5, 1.5)[pow(n, 0) - 1]


@pytest.mark.parametrize("n", [-2, -1, 1, 2, 5])
@pytest.mark.parametrize(
    "function",
    [by_constant, by_argument, of_argument, alternating, by_name, in_place, beyond_64_bits],
)
def test_integers_are_those_of_python(function, n):
    compiled = njit(**JIT)(take_snapshot(function).frozen()[0])
    assert compiled(n) == pytest.approx(function(n), rel=1e-15)


def test_a_power_with_a_constant_exponent_stays_an_integer():
    compiled = njit(**JIT)(take_snapshot(squares).frozen()[0])
    assert [compiled(n) for n in (0, 1, 2)] == [squares(n) for n in (0, 1, 2)]
