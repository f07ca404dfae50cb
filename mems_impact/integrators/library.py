"""Functions of Python's library, written over numbers, for compilers that do not know them.

The values are Python's, up to rounding where Python's own are not exact. Where Python raises an
arithmetic exception, they contain the root of a negative number, or an exponential that is too
large.
"""

from __future__ import annotations

import builtins
import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

LARGEST_ROOT = 3037000499  # integer part of the root of the largest 64-bit integer
SPLITTER = 134217729.0  # 2^27 + 1, which halves the digits of a number (Dekker)
COMPENSATED = sys.version_info >= (3, 12)  # sums of real numbers
MOST_DIGITS = 22  # the power of ten with this exponent is the largest one without rounding error
ALL_INTEGER = 2.0**52  # from which all real numbers are integers

# mypy: disable-error-code="no-untyped-def"


# --- Real numbers


def dist(p, q):
    """Return the distance of two points."""
    if len(p) != len(q):
        raise ValueError("both points must have the same number of dimensions")
    result = 0.0
    for a, b in zip(p, q):  # noqa: B905  # numba knows no strict zip
        result = math.hypot(result, a - b)
    return result


def fmod(x, y):
    """Return the remainder with the sign of x."""
    return _defined(np.fmod(float(x), float(y)), float(x), float(y))


def _defined(value, x, y):
    return math.sqrt(-1.0) if math.isnan(value) and x == x and y == y else value


def hypot(x=0.0, y=0.0, z=None, w=None):
    """Return the length of a vector of up to four components."""
    if z is None:
        return math.hypot(x, y)
    if w is None:
        return math.hypot(math.hypot(x, y), z)
    return math.hypot(math.hypot(math.hypot(x, y), z), w)


def isclose(a, b, *, rel_tol=1e-09, abs_tol=0.0):
    """Return whether two numbers are close."""
    if a == b or math.isinf(a) or math.isinf(b):
        return a == b
    return abs(a - b) <= max(rel_tol * max(abs(a), abs(b)), abs_tol)


def cbrt(x):
    """Return the cube root. That of numba 0.63 loses the sign of zero, and digits."""
    root = -np.cbrt(-x) if math.copysign(1.0, x) < 0.0 else np.cbrt(x)
    if x == 0.0 or not math.isfinite(x):
        return root
    return root - (root - x / (root * root)) / 3.0


def ldexp(x, i):
    """Return x 2^i."""
    value = math.ldexp(x, min(max(i, -5000), 5000))
    return math.exp(1e3) if math.isinf(value) and math.isfinite(x) else value


def log(x, base=None):
    """Return the logarithm to a base."""
    if base is None:
        return math.log(x)
    return math.log(x) / (math.sqrt(-1.0) if base <= 0.0 else math.log(base))


def modf(x):
    """Return fraction and whole part."""
    if math.isinf(x):
        return math.copysign(0.0, x), x
    fraction = np.fmod(x, 1.0)
    return fraction, math.copysign(x - fraction, x)


def remainder(x, y):
    """Return the remainder after the nearest multiple."""
    if (math.isinf(y) and math.isfinite(x)) or (x == 0.0 and abs(y) > 0.0):
        return float(x)
    size, divisor = abs(x), abs(y)
    rest = np.fmod(size, divisor)
    other = divisor - rest
    if rest > other:
        rest = -other
    elif rest == other:
        rest -= 2.0 * np.fmod(0.5 * (size - rest), divisor)
    return _defined(math.copysign(1.0, x) * rest, x, y)


def round_to_digits(x, digits):
    """Return x rounded to decimal digits, a tie to the even one."""
    if digits > MOST_DIGITS or digits < -MOST_DIGITS:
        raise ValueError("more than 22 digits")
    if not math.isfinite(x):
        return x
    unit = 10.0 ** abs(digits)
    if digits > 0:
        if abs(x) >= ALL_INTEGER or abs(x) * unit >= 2.0 * ALL_INTEGER:
            return x
        high = x * unit
        # The error of the product (Dekker).
        a, b = SPLITTER * x, SPLITTER * unit
        a, b = a - (a - x), b - (b - unit)
        low = ((a * b - high) + a * (unit - b) + (x - a) * b) + (x - a) * (unit - b)
        nearest = np.rint(high)
        rest = (high - nearest) + low
        if abs(rest) > 0.5 or (abs(rest) == 0.5 and np.fmod(nearest, 2.0) != 0.0):
            nearest += math.copysign(1.0, rest)
        return math.copysign(nearest / unit, x)
    size = abs(x)
    if size >= 4.0 * ALL_INTEGER * unit or (digits == 0 and size >= ALL_INTEGER):
        return x
    if size >= ALL_INTEGER * unit:
        raise ValueError("more digits than a real number has")
    rest = np.fmod(size, unit)
    nearest = np.rint((size - rest) / unit)
    if 2.0 * rest > unit or (2.0 * rest == unit and np.fmod(nearest, 2.0) != 0.0):
        nearest += 1.0
    return math.copysign(nearest * unit, x)


def round(number, ndigits=None):
    """Return a number rounded to an integer, or to decimal digits."""
    if ndigits is None:
        return builtins.round(number)
    return round_to_digits(number, ndigits)


def ulp(x):
    """Return the value of the last bit."""
    if not math.isfinite(x):
        return abs(x)
    size = abs(x)
    above = math.nextafter(size, math.inf)
    return size - math.nextafter(size, 0.0) if math.isinf(above) else above - size


def floor_divide(a, b):
    """Return the quotient, rounded down."""
    return a // b


def modulo(a, b):
    """Return the remainder with the sign of b."""
    return a % b


# --- Integers


def comb(n, k):
    """Return the number of choices of k of n."""
    if n < 0 or k < 0:
        raise ValueError("n and k must not be negative")
    result = 0 if k > n else 1
    for i in range(min(k, n - k)):
        result = result * (n - i) // (i + 1)
    return result


def factorial(n):
    """Return n!."""
    if n < 0:
        raise ValueError("n must not be negative")
    result = 1
    for i in range(2, n + 1):
        result *= i
    return result


def _gcd(a, b):
    while b != 0:
        a, b = b, a % b
    return abs(a)


def gcd(a=0, b=0, c=0):
    """Return the greatest common divisor of up to three integers."""
    return _gcd(_gcd(a, b), c)


def isqrt(n):
    """Return the integer part of the square root."""
    if n < 0:
        raise ValueError("n must not be negative")
    root = min(int(math.sqrt(n)), LARGEST_ROOT)
    return root - 1 if root * root > n else root


def _lcm(a, b):
    return 0 if a == 0 or b == 0 else abs(a // _gcd(a, b) * b)


def lcm(a=1, b=1, c=1):
    """Return the least common multiple of up to three integers."""
    return _lcm(_lcm(a, b), c)


def perm(n, k=None):
    """Return the number of ordered choices of k of n."""
    count = n if k is None else k
    if n < 0 or count < 0:
        raise ValueError("n and k must not be negative")
    result = 0 if count > n else 1
    if count <= n:
        for i in range(count):
            result *= n - i
    return result


# --- Several numbers


def all(values):
    """Return whether all values are true."""
    for value in values:  # noqa: SIM110  # this is what `all` means
        if not value:
            return False
    return True


def any(values):
    """Return whether some value is true."""
    for value in values:  # noqa: SIM110
        if value:
            return True
    return False


def divmod(a, b):
    """Return quotient and remainder."""
    return a // b, a % b


def prod(values, *, start=1):
    """Return the product."""
    result = start
    for value in values:
        result *= value
    return result


def reversed(values):
    """Return a tuple from its end."""
    return values[::-1]


def sum(values, start=0):
    """Return the sum, as Python does from 3.12 on with what rounding has lost (Neumaier)."""
    result, lost = start, 0
    for value in values:
        total = result + value
        if not COMPENSATED:
            lost = 0
        elif abs(result) >= abs(value):
            lost += (result - total) + value
        else:
            lost += (value - total) + result
        result = total
    return result + lost if math.isfinite(lost) else result


FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.float64: float,
    np.int64: int,
    np.bool_: bool,
    np.divmod: divmod,
    np.floor_divide: floor_divide,
    np.mod: modulo,
    np.remainder: modulo,
    **{
        getattr(math, function.__name__): function
        for function in (
            *(cbrt, comb, dist, factorial, fmod, gcd, hypot, isclose, isqrt, lcm, ldexp, log, modf),
            *(perm, prod, remainder, ulp),
        )
    },
    **{
        getattr(builtins, function.__name__): function
        for function in (all, any, divmod, reversed, round, sum)
    },
}
"""The functions, by the functions of Python that they replace."""
