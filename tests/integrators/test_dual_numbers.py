"""Derivatives of functions by numbers with tangents, compiled and interpreted."""

import math

import mpmath
import numpy as np
import pytest
from numba import njit, types

import mems_impact as mi
from mems_impact.hybrid.variational.tangents import (
    flow_jacobian,
    jacobian_memory,
)
from mems_impact.integrators.derivatives import UNARY
from mems_impact.integrators.dual_numbers import FUNCTIONS, Dual, copy_for_tangents, plain
from mems_impact.integrators.jit.closures import take_snapshot, try_compile
from mems_impact.integrators.jit.dual_numbers import vector_at
from mems_impact.integrators.jit.numba_support import JIT

WIDTH = 2
view = vector_at(WIDTH)
# Added to arguments within (0, 1).
OUTSIDE = {math.acosh: 1.0, math.tanh: 15.0, math.expm1: -30.0}


def compiled(function):
    """Return a function of two numbers that gives value and derivatives, of compiled code."""
    (copy,) = take_snapshot(function).frozen()

    @njit(**JIT)
    def evaluate(numbers, result):
        given = view(numbers.ctypes.data, 2)
        view(result.ctypes.data, 1)[0] = copy(given[0], given[1])

    def value_and_derivatives(x, y):
        result = np.zeros((1, 1 + WIDTH))
        evaluate(np.array([[x, 1.0, 0.0], [y, 0.0, 1.0]]), result)
        return result[0]

    return value_and_derivatives


def interpreted(function, x, y):
    """Return the same of interpreted code."""
    number = function(Dual(x, np.array([1.0, 0.0])), Dual(y, np.array([0.0, 1.0])))
    return np.array([number.value, *number.slope])


EXACT = {
    math.exp2: lambda x: x**0 * 2**x,
    math.log2: lambda x: mpmath.log(x, 2),
    math.lgamma: mpmath.loggamma,
}


OF_MATH = [function for function in UNARY if not isinstance(function, np.ufunc)]


@pytest.mark.parametrize("function", OF_MATH, ids=lambda function: function.__name__)
def test_derivatives_of_elementary_functions(function):
    """Against 50 digits, interpreted and compiled."""
    reference = EXACT.get(function) or getattr(mpmath, function.__name__)
    as_written = compiled(eval(f"lambda x, y: math.{function.__name__}(x)", {"math": math}))
    for x in np.random.default_rng(5).uniform(0.05, 0.95, 3) + OUTSIDE.get(function, 0.0):
        with mpmath.workdps(50):
            exact = float(mpmath.diff(reference, mpmath.mpf(x)))
        by_dual = interpreted(lambda x, y: FUNCTIONS[function](x), x, 0.0)
        assert by_dual[0] == function(x)
        assert by_dual[1:] == pytest.approx([exact, 0.0], rel=1e-14)
        assert as_written(x, 0.0) == pytest.approx(by_dual, rel=2e-15)


def written(source):
    """Return a function of a source, which numba finds."""
    space = {"math": math, "np": np, "TABLE": np.array([0.0, 0.5, 1.0, 2.0])}
    exec(f"def f(x, y):\n{source}", space)
    return space["f"]


CONSTRUCTS = {
    "a loop": "    s = 0\n    for k in range(4):\n        s += x**k * y\n    return s",
    "a branch": "    return x * y if x > y else x + 2 * y",
    "an integer at first": "    s = 0\n    if x > 0:\n        s = x\n    return 1 + s",
    "powers": "    return x**2 + x**-3 + x**2.5 + x**y + 2**y + math.pow(x, 3)",
    "in place": "    x -= 1\n    x *= 3 * y\n    x /= 2\n    x **= 2\n    return x",
    "min and max": "    return min(x, 2.0, y) * max(0, x) + np.maximum(x, y) - np.minimum(1, x)",
    "sizes": "    return abs(x - y)**1.5 + math.copysign(x, -1) + np.sign(x) * y + math.fabs(y)",
    "remainders": "  return math.fmod(x, 0.4) * divmod(y, 0.3)[1] + x % 0.4 - math.remainder(y, 1)",
    "steps": "    return x - math.floor(x) + y // 0.4 + int(x) * y + round(x) * x + math.trunc(y)",
    "steps of NumPy": "    y //= 0.4\n    x %= 0.7\n    return x * x * np.ceil(y) - np.floor(x)",
    "a table": "    return y * TABLE[np.searchsorted(TABLE, x)] + x * TABLE[np.digitize(y, TABLE)]",
    "of NumPy": "    return np.sin(x) * np.exp(y) + np.sqrt(x) + np.tanh(x * y) + np.power(x, 2)",
    "operators of NumPy": "    return np.add(x, y) * np.square(x) - np.divide(np.negative(x), y)",
    "choices of NumPy": "    return np.fmax(x, y) * np.less(y, x) + np.fmin(y, 2) - np.fabs(-x)",
    "types of NumPy": "    return np.float64(x) * np.int64(1.5) + np.reciprocal(y) * np.bool_(x)",
    "sums of powers": "    return np.logaddexp(x, y) * np.logaddexp2(y, x) + np.float_power(x, y)",
    "choices of many": "    return min(9, x * y, 7.0, x + y, 8.0, x) * max((y, 0, x, 0.1, x - y))",
    "of two": "    return math.hypot(x, y) + math.atan2(x, y) + math.hypot(x, y, 2) * math.log(x)",
    "tuples": "    a, b = (x, y * x)\n    return sum((a, b, 1.0)) + math.prod((a, 2, b))",
    "pairs": "    s = 0\n    for i, v in enumerate((x, y)):\n        s += i * v * v\n    return s",
    "chained": "    return x if 0.0 < y < x < 5.0 else y",
    "special": "    return math.gamma(x) + math.lgamma(y) + math.erf(x) + math.ldexp(y, 3)",
    "conversions": "    return float(x) * bool(y) + (x > 1.0) * y + math.radians(x)",
}


@pytest.mark.parametrize("name", CONSTRUCTS)
def test_derivatives_of_what_users_write(name):
    """Against differences of the same function; values have the bits of the function."""
    function, at = written(CONSTRUCTS[name]), np.array([1.3, 0.7])
    exact = [function(*at.tolist())]
    for direction in np.eye(2):
        values = [function(*(at + h * direction).tolist()) for h in (1e-3, -1e-3, 5e-4, -5e-4)]
        first, second = (values[0] - values[1]) / 2e-3, (values[2] - values[3]) / 1e-3
        exact.append((4.0 * second - first) / 3.0)  # Richardson: error of fourth order
    numbers = [
        Dual(value, tangents) for value, tangents in zip(at.tolist(), np.eye(2), strict=True)
    ]
    given = copy_for_tangents(function)(*numbers)
    for result in ([given.value, *given.slope], compiled(function)(*at)):
        assert result[0] == pytest.approx(exact[0], rel=4e-16)
        assert result == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize(
    ("source", "at", "value"),
    [
        ("abs(x)", 0.0, 0.0),
        ("abs(x)", -0.0, 0.0),
        ("max(x, 0.0)", 0.0, 1.0),
        ("max(0.0, x)", 0.0, 0.0),
        ("min(x, y)", 1.0, 1.0),
        ("x**0", 0.0, 0.0),
        ("x**1", 0.0, 1.0),
        ("x**2", 0.0, 0.0),
        ("x**1.5", 0.0, 0.0),
        ("x**0.0", 0.0, 0.0),
        ("x**0.5", 0.0, math.inf),
        ("math.sqrt(x)", 0.0, math.inf),
        ("math.sqrt(x)", -0.0, math.inf),
        ("math.cbrt(x)", 0.0, math.inf),
        ("math.cbrt(x)", -0.0, math.inf),
        ("math.cbrt(x)", -math.inf, 0.0),
        ("np.cbrt(x)", 0.0, math.inf),
        ("np.log(x)", 0.0, math.inf),
        ("math.acos(x)", 1.0, -math.inf),
        ("np.arcsin(x)", -1.0, math.inf),
        ("math.acosh(x)", 1.0, math.inf),
        ("math.atan2(x, y - 1.0)", 0.0, math.nan),
        ("math.atan2(y - 1.0, 0.0) + x", 1.0, 1.0),
        ("math.atan2(y * 1e-200, x)", 1e-200, -5e199),
        ("math.remainder(x, 2.0)", 0.0, 1.0),
        ("math.fmod(x, 2.0)", 2.0, 1.0),
        ("np.sign(x) * x", 0.0, 0.0),
        ("np.maximum(x, y)", 1.0, 1.0),
        ("np.minimum(1.0, x)", math.nan, 1.0),
        ("np.fmax(x, 1.0)", math.nan, 0.0),
        ("abs(x)", math.nan, math.nan),
        ("math.sqrt(y - 1.0) + x", 1.0, 1.0),
        ("math.hypot(y - 1.0, 0.0) + x", 1.0, 1.0),
        ("0.0 if x == 0.0 else 5.0 * x", 0.0, 0.0),
        ("x if math.isnan(x) else 3.0 * x", math.nan, 1.0),
        ("max(x, 1.0)", math.inf, 1.0),
        ("math.copysign(x, y)", -0.0, 0.0),
        ("1.0 % x", 0.1, -9.0),  # 1.0 / 0.1 is rounded to 10
    ],
)
def test_derivatives_at_kinks(source, at, value):
    """By the rules of the module; the tangents of y are zero here."""
    function = written(f"    return {source}")
    given = copy_for_tangents(function)(Dual(at, np.array([1.0])), Dual(1.0, np.array([0.0])))
    slopes = [plain(given.slope[0]) if isinstance(given, Dual) else 0.0]
    slopes.append(compiled(function)(at, 1.0)[1])
    assert slopes == pytest.approx([value, value], rel=1e-15, nan_ok=True)


@pytest.mark.parametrize("condition", ["type(x) is float", "hasattr(x, 'hex')"])
def test_a_question_for_the_type_of_a_number_is_refused(condition):
    """Compiled, numba would give another answer than Python."""
    function = written(f"    return x if {condition} else 2.0 * x")
    with pytest.raises(TypeError, match="asks for the type of a number"):
        copy_for_tangents(function)(Dual(1.0, np.ones(1)), 1.0)
    assert "no compiled form" in try_compile(function, (types.float64,) * 2).problem


RATES = (0.04, 3e7, 1e4)  # Robertson 1966


def reactions(mode, t, y, p):
    slow = RATES[0] * y.a - RATES[2] * y.b * y.c
    fast = RATES[1] * y.b * y.b
    return -slow, slow - fast, fast


def refusing(mode, t, y, p):
    return reactions(mode, t, y, p) if isinstance(y.a, float) else y.unknown


@pytest.mark.parametrize("engine", ["compiled", "interpreted"])
@pytest.mark.parametrize("flow", [reactions, refusing])
def test_newton_by_a_flow_with_and_without_tangents(flow, engine):
    """Against the solution of Hairer and Wanner at t = 40."""
    stiff = mi.System(states=("a", "b", "c"), flow=flow, initial={"a": 1.0})
    options = mi.Options(method="bdf", rtol=1e-9, atol=1e-14, engine=engine)
    final = mi.simulate(stiff, duration=40.0, options=options).final
    exact = (0.7158270688, 9.185534765e-6, 0.2841637457)
    assert (final.a, final.b, final.c) == pytest.approx(exact, rel=1e-6)


def test_the_jacobian_of_a_flow():
    def flow(mode, t, y, p, dy):
        for i in range(5):
            dy[i] = p[0] * y[i] * y[i - 1] + math.sin(t)

    y, entries = [0.3, 0.1, -0.7, 1.1, 2.0], np.zeros((5, 5))
    memory = [0.0] * jacobian_memory(5, 1)
    flow_jacobian(flow, 5, 1)(0, 0.4, y, [2.5], memory, entries)
    exact = np.zeros((5, 5))
    for i in range(5):
        exact[i, i], exact[i, i - 1] = 2.5 * y[i - 1], 2.5 * y[i]
    assert entries == pytest.approx(exact, rel=1e-15)
