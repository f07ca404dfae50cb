"""Functions of Python's library in compiled code and in C, against those of Python."""

import itertools
import math
import re

import numpy as np
import pytest
from numba import njit, types

from mems_impact.integrators.jit.closures import take_snapshot, try_compile
from mems_impact.integrators.jit.numba_support import JIT

REALS = (0.0, -0.0, 1.0, -0.5, 2.5, -7.3, 2.675, 1e-300, 5e-324, 1e16, -1e300, math.inf, math.nan)
SMALL = (-2, 0, 1, 2, 5, 12, 21)

OF_REALS = {
    "cbrt": lambda x, y: math.cbrt(x) + 0.0 * y,
    "dist": lambda x, y: math.dist((x, y), (1.0, 2.0)),
    "fmod": lambda x, y: math.fmod(x, y),
    "hypot": lambda x, y: math.hypot(x, y, 1.0),
    "isclose": lambda x, y: math.isclose(x, y, rel_tol=0.1, abs_tol=1e-3),
    "log": lambda x, y: math.log(x, y),
    "modf": lambda x, y: math.modf(x)[0] + math.copysign(1.0, math.modf(y)[1]),
    "remainder": lambda x, y: math.remainder(x, y),
    "ulp": lambda x, y: math.ulp(x) + 0.0 * y,
    "rounded": lambda x, y: round(x, 2) + round(y, -1),
    "round": lambda x, y: round(x) if y > 0.0 else 0,
    "any": lambda x, y: any((x, y)) + 2 * any((x > 1.0, y > 1.0, 0)) + any(()),
    "all": lambda x, y: all((x, y)) + 2 * all((x > 1.0, y > 1.0, 1)) + all(()),
    "sum": lambda x, y: sum((x, y)) + sum((x, 1, y), 0.5) + sum(()),
    "prod": lambda x, y: math.prod((x, y), start=2.0),
    "divmod": lambda x, y: divmod(x, y)[1],
    "reversed": lambda x, y: math.dist(tuple(reversed((x, y))), (1.0, 2.0)),
    "numpy": lambda x, y: float(np.mod(x, 0.3)) + float(np.floor_divide(y, 0.1)),
}
OF_INTEGERS = {
    "comb": lambda i, j: math.comb(i, j),
    "factorial": lambda i, j: math.factorial(i) + j,
    "gcd": lambda i, j: math.gcd(i, j, 6),
    "isqrt": lambda i, j: math.isqrt(i * 1000003) + j,
    "lcm": lambda i, j: math.lcm(i, j, 6),
    "perm": lambda i, j: math.perm(i, j),
    "ldexp": lambda i, j: math.ldexp(1.5, i * 2**40) + j,
    "prod": lambda i, j: math.prod((i, j, 3)),
}


TERMS = [(0.1, 0.2, 0.3), (1e16, 1.0, -1e16), (1.0, 1e100, 1.0, -1e100), (1e308, 1e308), (2.5,)]


@pytest.mark.quick(2)
@pytest.mark.parametrize("terms", TERMS, ids=str)
def test_a_sum_of_reals_has_the_bits_of_python(terms):
    """From Python 3.12 on with the digits that rounding loses."""
    compiled = njit(**JIT)(take_snapshot(lambda terms: sum(terms)).frozen()[0])
    assert compiled(terms) == sum(terms)


def outcome(function, *arguments):
    """The value, or None if an exception is raised."""
    try:
        return function(*arguments)
    except (ArithmeticError, ValueError, StopIteration):  # the last one where it is undefined
        return None


def agree(value, right):
    """Whether a compiled value is that of Python, and none where Python raises."""
    if value is None:
        return right is None or abs(right) >= 2**63
    if right is None:
        return False
    if math.isnan(right):
        return math.isnan(value)
    if right == 0.0:
        return value == 0.0 and math.copysign(1.0, value) == math.copysign(1.0, right)
    return value == pytest.approx(right, rel=2e-15, abs=0.0)


@pytest.mark.slow(all=True)
@pytest.mark.parametrize(
    ("function", "values"),
    [(each, REALS) for each in OF_REALS.values()]
    + [(each, SMALL) for each in OF_INTEGERS.values()],
    ids=[*OF_REALS, *(f"{name} of integers" for name in OF_INTEGERS)],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_compiled_values_are_those_of_python(function, values):
    machine = njit(**JIT)(take_snapshot(function).frozen()[0])
    for arguments in itertools.product(values, values):
        assert agree(outcome(machine, *arguments), outcome(function, *arguments)), arguments


def test_rounding_to_digits_is_exact():
    def rounded(x, digits):
        return round(x, digits)

    machine = njit(**JIT)(take_snapshot(rounded).frozen()[0])
    generator = np.random.default_rng(3)
    values = generator.uniform(-1.0, 1.0, 2000) * 10.0 ** generator.integers(-8, 18, 2000)
    ties = np.round(generator.uniform(-1e4, 1e4, 1000), 2) + 0.005
    for x in (*values.tolist(), *ties.tolist()):
        for digits in (-3, 0, 1, 2, 7, 15):
            assert machine(x, digits) == round(x, digits), (x, digits)


REFUSED = {
    "fsum": (lambda x: math.fsum((x, x)), "math.fsum has no compiled form"),
    "generator": (lambda x: sum(k * x for k in range(3)), "it has a generator expression"),
    "sorted": (lambda x: sorted((x, 1.0))[0], "it creates a list, an array or a string"),
    "key": (lambda x: max(x, 1.0, key=abs), "(max|it) has .*no compiled form"),
    "method": (lambda x: x.is_integer(), "it reads the attribute 'is_integer' of a value without"),
    "norm": (lambda x: np.linalg.norm(x), "norm has no compiled form for these arguments"),
    "iteration": (lambda x: sum(x), "it loops over a value that is no range, array or tuple"),
}


@pytest.mark.slow(all=True)
@pytest.mark.parametrize("name", REFUSED)
def test_a_refusal_is_one_sentence(name):
    function, sentence = REFUSED[name]
    problem = try_compile(function, (types.float64,)).problem
    assert re.match(sentence, problem)
    assert "\n" not in problem
