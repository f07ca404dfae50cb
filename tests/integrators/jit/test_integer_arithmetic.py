"""Integers of compiled functions against those of Python."""

import itertools
import math

import pytest
from numba import njit
from numba.core.errors import NumbaError

from mems_impact.integrators.jit.closures import take_snapshot
from mems_impact.integrators.jit.numba_support import JIT

TURNS = 4
EXPONENT = -3
LIGHT_SPEED = 299792458
BEYOND = 2**64 + 3

INTEGERS = (0, 1, -1, 2, 3, -7, 20, 62, 63, 64, 2**31, 2**53 + 1, -(2**62), 2**63 - 1, -(2**63))
NUMBERS = (0.0, -0.0, 0.5, 1.5, 2.5, -2.5, 1e19, -1e19, -(2.0**63), 2.0**63, math.inf, math.nan)


def compiled(function):
    return njit(**JIT)(take_snapshot(function).frozen()[0])


def outcome(function, *arguments):
    """The value, or None if Python raises an exception."""
    try:
        return function(*arguments)
    except (ArithmeticError, ValueError, StopIteration):  # the last one where it is undefined
        return None


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


def beyond_64_bits(n):
    cubed = LIGHT_SPEED**3 + 1.0 * n
    return -LIGHT_SPEED * LIGHT_SPEED * LIGHT_SPEED * (0.5 + n) + 2 * cubed + LIGHT_SPEED**2 // 7


def evaluated(n):
    return LIGHT_SPEED**3 % 7 + BEYOND // 10**18 + (2**70 >> 68) + float(2**500) * n


def squares(n):
    return (0.5, 1.5, 2.5, 3.5, 4.5)[n**2] + (0.5, 1.5)[pow(n, 0) - 1]


@pytest.mark.slow(all=True)
@pytest.mark.parametrize("n", [-2, -1, 1, 2, 5])
@pytest.mark.parametrize(
    "function",
    [
        *(by_constant, by_argument, of_argument, alternating, by_name, in_place, beyond_64_bits),
        evaluated,
    ],
)
def test_powers_and_large_constants(function, n):
    assert compiled(function)(n) == pytest.approx(function(n), rel=1e-15)


def test_a_power_with_a_constant_exponent_stays_an_integer():
    assert [compiled(squares)(n) for n in (0, 1, 2)] == [squares(n) for n in (0, 1, 2)]


def test_a_power_by_a_variable_is_as_exact_as_in_python():
    def power(x, n):
        return x**n

    assert compiled(power)(1.0000001, 10**6) == pytest.approx(1.0000001 ** (10**6), rel=1e-15)


OPERATIONS = {
    "sum": lambda i, j: i + j,
    "difference": lambda i, j: i - j,
    "product": lambda i, j: i * j,
    "negative": lambda i, j: -i + 0 * j,
    "size": lambda i, j: abs(i) + 0 * j,
    "quotient": lambda i, j: i // j,
    "remainder": lambda i, j: i % j,
    "both": lambda i, j: divmod(i, j)[0] + divmod(i, j)[1],
    "left": lambda i, j: i << j if j < 1000 else i,
    "right": lambda i, j: i >> j,
    "cube": lambda i, j: i**3 + j,
    "ratio": lambda i, j: i / j if j != 0 else 0.0,
    "of a tuple": lambda i, j: sum((i, j, 1)),
    "order": lambda i, j: float(j) < i,
    "equality": lambda i, j: i == 1.0 * j,
}


@pytest.mark.slow(all=True)
@pytest.mark.parametrize("name", OPERATIONS)
def test_an_integer_is_that_of_python_or_an_error(name):
    function = OPERATIONS[name]
    machine = compiled(function)
    for i, j in itertools.product(INTEGERS, INTEGERS):
        right = outcome(function, i, j)
        value = outcome(machine, i, j)
        if value is None:
            assert right is None or abs(right) > 2**63 - 1 or max(abs(i), abs(j)) > 2**53
        else:
            assert value == right, (i, j)


def test_sums_and_products_within_64_bits_are_no_errors():
    values = (-(2**31), -5, 0, 3, 2**31)
    for name in ("sum", "difference", "product", "quotient", "remainder", "ratio"):
        function, machine = OPERATIONS[name], compiled(OPERATIONS[name])
        for i, j in itertools.product(values, (-3, 1, 2**31)):
            assert machine(i, j) == function(i, j)


@pytest.mark.quick(2)
@pytest.mark.parametrize("convert", [int, round, math.floor, math.ceil, math.trunc])
def test_the_integer_of_a_real_number_is_that_of_python_or_an_error(convert):
    def function(x):
        return convert(x)

    machine = compiled(function)
    for x in NUMBERS:
        value, right = outcome(machine, x), outcome(function, x)
        assert value == right if value is not None else (right is None or abs(right) >= 2**63)


def factorial(n):
    k = 1
    for i in range(1, n + 1):
        k = k * i
    return k


def fibonacci(n):
    a, b = 0, 1
    for _ in range(n):
        a, b = b, a + b
    return a


def digits(n):
    k = 7
    for _ in range(n):
        k <<= 2
        k += 1
    return k


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("function", "largest"), [(factorial, 20), (fibonacci, 91), (digits, 30), (math.factorial, 20)]
)
def test_a_loop_ends_with_an_error_where_64_bits_do_not_suffice(function, largest):
    def call(n):
        return function(n)

    machine = compiled(call)
    assert machine(largest) == function(largest)
    with pytest.raises(OverflowError, match="exceeds the 64 bits of compiled integers"):
        machine(largest + 2)


def of_an_integer(n):
    return BEYOND - n


def of_a_loop(n):
    k = 2**64
    for _ in range(n):
        k = k // 3
    return k


def modulo_a_power(n):
    k = 12345
    for _ in range(n):
        k = (6364136223846793005 * k + 1442695040888963407) % 2**64
    return k


@pytest.mark.parametrize("function", [of_an_integer, of_a_loop, modulo_a_power])
def test_a_constant_beyond_64_bits_is_refused_among_integers(function):
    with pytest.raises(NumbaError):
        compiled(function)(3)


def test_real_numbers_are_left_as_they_are():
    def function(x):
        return x * BEYOND + x**3 - abs(x) // 0.3

    assert compiled(function)(1.7) == function(1.7)
