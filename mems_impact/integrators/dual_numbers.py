"""Numbers with tangents, interpreted: exact derivatives of Python functions.

A `Dual` is a value with tangents. Values and tangents may be dual numbers themselves, which gives
higher derivatives. `mems_impact.integrators.jit.dual_numbers` is the same for numba.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.integrators import library
from mems_impact.integrators.derivatives import (
    BINARY,
    EXPRESSIONS,
    PIECEWISE_CONSTANT,
    UNARY,
    digamma,
    of_numpy,
)
from mems_impact.integrators.substitution import Substitution


class Dual:
    """A number with tangents, `slope`: shape (w,), or of a dual value a dual number."""

    __slots__ = ("slope", "value")
    __array_ufunc__ = None  # products with arrays are left to this class
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, value: Any, slope: Any) -> None:
        self.value, self.slope = value, slope

    def __repr__(self) -> str:
        return f"Dual({self.value!r}, {self.slope!r})"

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slope)

    def __pos__(self) -> Dual:
        return self

    def __abs__(self) -> Dual:
        number = plain(self)
        if number > 0.0 or number < 0.0:
            return self if number > 0.0 else -self
        return _chain(abs(self.value), 0.0 * self.value, self)  # NaN of NaN

    def __bool__(self) -> bool:
        return bool(plain(self))

    def __int__(self) -> int:
        return int(plain(self))

    def __floor__(self) -> int:
        return math.floor(plain(self))

    def __ceil__(self) -> int:
        return math.ceil(plain(self))

    def __trunc__(self) -> int:
        return math.trunc(plain(self))

    def __round__(self, digits: int | None = None) -> Any:
        return round(plain(self), digits)

    def __floordiv__(self, other: Any) -> Any:
        return plain(self) // plain(other)

    def __rfloordiv__(self, other: Any) -> Any:
        return plain(other) // plain(self)


def plain(number: Any) -> Any:
    """Return the value of a number, without tangents of any order."""
    while isinstance(number, Dual):
        number = number.value
    return number


def derivatives(
    function: Callable[[list[Any]], list[Any]], x: Floats, frame: Floats, *along: Floats
) -> Floats:
    """Return the derivatives of a function of a list of numbers by all vectors of a frame.

    With `x` of shape (n,) and a frame of shape (n, w), vectors as columns, the shape is
    (results, w). Further vectors `along`, each of shape (n,), give the derivative of order k + 1
    along k of them and each of the frame.
    """
    seeds: list[Any] = x.tolist()
    zero: Any = np.zeros(frame.shape[1])
    for i in np.flatnonzero(np.column_stack([frame, *along]).any(axis=1)).tolist():
        seeds[i] = Dual(seeds[i], frame[i])
        for vector in along:
            seeds[i] = Dual(seeds[i], _constant(float(vector[i]), seeds[i]))
    rows = []
    for number in function(seeds):
        order = _order(number)
        for _ in range(order):
            number = number.slope
        rows.append(number if order else zero)
    return np.array(rows, dtype=float).reshape(len(rows), frame.shape[1])


def _constant(value: float, like: Dual) -> Dual:
    """Return a number without rates, of the order of another."""
    if isinstance(like.value, Dual):
        slope: Any = _constant(0.0, like.value)
        return Dual(_constant(value, like.value), slope)
    return Dual(value, 0.0 if isinstance(like.slope, float) else np.zeros_like(like.slope))


def _order(number: Any) -> int:
    return 1 + _order(number.value) if isinstance(number, Dual) else 0


def _times(factor: Any, slope: Any) -> Any:
    """Return a derivative times tangents; a tangent of zero stays zero."""
    if isinstance(slope, Dual) or math.isfinite(plain(factor)):
        return factor * slope
    with np.errstate(invalid="ignore"):
        return np.where(slope == 0.0, 0.0, factor * slope)


def _chain(value: Any, derivative: Any, x: Dual) -> Dual:
    return Dual(value, _times(derivative, x.slope))


def _rule(source: str) -> Callable[..., Any]:
    """Return a rule as a function, of real or of dual numbers; it may be infinite."""
    of_reals, of_duals = (eval(source, names) for names in (_MATH, _GENERIC))

    def derivative(*numbers: Any) -> Any:
        function = of_duals if isinstance(numbers[-1], Dual) else of_reals
        try:
            return function(*numbers)
        except (ArithmeticError, ValueError):
            with np.errstate(all="ignore"):
                return of_duals(*map(_of_numpy, numbers))

    return derivative


_MATH = {**vars(math), "digamma": digamma}
_GENERIC = {**_MATH}  # and functions of dual numbers


def _of_numpy(number: Any) -> Any:
    """Return a number of NumPy, whose quotients by zero are infinite."""
    if isinstance(number, Dual):
        return Dual(_of_numpy(number.value), number.slope)
    return np.float64(number)


def _unary(function: Callable[..., Any], source: str) -> Callable[..., Any]:
    derivative = _rule(f"lambda v, f: {source}")

    def of_number(x: Any) -> Any:
        if not isinstance(x, Dual):
            return function(x)
        v, f = x.value, of_number(x.value)
        return _chain(f, derivative(v, f), x)

    return of_number


def _binary(function: Callable[..., Any], by_first: str, by_second: str) -> Callable[..., Any]:
    derivatives = [_rule(f"lambda a, b, f: {each}") for each in (by_first, by_second)]

    def of_numbers(x: Any, y: Any) -> Any:
        order = max(_order(x), _order(y))
        if order == 0:
            return function(x, y)
        pair = [each if _order(each) == order else Dual(each, None) for each in (x, y)]
        a, b = (each.value for each in pair)
        f = of_numbers(a, b)
        terms = [
            _times(derivative(a, b, f), each.slope)
            for derivative, each in zip(derivatives, pair, strict=True)
            if each.slope is not None
        ]
        return Dual(f, sum(terms[1:], terms[0]))

    return of_numbers


_power = _binary(operator.pow, *BINARY[operator.pow])


def _raised(x: Any, y: Any) -> Any:
    """Return a power; a constant integer exponent is one of products."""
    if isinstance(y, int) and isinstance(x, Dual):
        return _chain(_raised(x.value, y), y * _raised(x.value, y - 1) if y else 0.0, x)
    return _power(x, y)


def _with_numpy(functions: Iterable[Any]) -> Iterator[tuple[Any, Any]]:
    """Yield functions of `math` and NumPy, with those that compute their values."""
    for function in functions:
        for each in (function, of_numpy(function)):
            if isinstance(each, np.ufunc):
                yield each, lambda *numbers, of=each: of(*numbers).item()
            elif each is not None:
                yield each, each


_OF_MATH: dict[Any, Callable[..., Any]] = {
    **{each: _unary(of, UNARY[key]) for key in UNARY for each, of in _with_numpy([key])},
    **{each: _binary(of, *BINARY[key]) for key in BINARY for each, of in _with_numpy([key])},
    **{each: lambda x, of=of: of(plain(x)) for each, of in _with_numpy(PIECEWISE_CONSTANT)},
    math.fabs: abs,
    math.pow: _power,
    **dict.fromkeys(
        (math.ldexp, np.ldexp), lambda x, i: x * 2.0**i if isinstance(x, Dual) else math.ldexp(x, i)
    ),
}
_GENERIC.update((function.__name__, dual) for function, dual in _OF_MATH.items())


def _of_reals_and_duals(of_reals: Any, of_duals: Any) -> Callable[[Any], Any]:
    return lambda x: (of_duals if isinstance(x, Dual) else of_reals)(x)


for _each in UNARY:  # infinite at a pole, in place of an exception
    if (_ufunc := of_numpy(_each)) is not None:
        _GENERIC[_each.__name__] = _of_reals_and_duals(_ufunc, _OF_MATH[_each])


def _typed(x: Any) -> Any:
    """Return what is no dual number, whose type is not that of the number."""
    if isinstance(x, Dual):
        raise TypeError("it asks for the type of a number")
    return x


FUNCTIONS: dict[Any, Callable[..., Any]] = {
    **_OF_MATH,
    **{each: eval(f"lambda x, y=None: {of}", _GENERIC) for each, of in EXPRESSIONS.items()},
    np.clip: lambda x, low, high: min(max(x, low), high),
    float: lambda x: x if isinstance(x, Dual) else float(x),
    type: lambda x: type(_typed(x)),
    hasattr: lambda x, name: hasattr(_typed(x), name),
}
FUNCTIONS[np.float64] = FUNCTIONS[float]
"""Functions that take numbers with tangents, by those of Python and NumPy."""

REALS = (float, int)


def _arithmetic(
    function: Callable[..., Any], slope: Callable[..., float], generic: Callable[..., Any]
) -> Callable[..., Any]:
    """Return an operation, in shorter time for real values with one real tangent."""

    def of_numbers(x: Any, y: Any) -> Any:
        a, c = (x.value, x.slope) if type(x) is Dual else (x, 0.0)
        b, d = (y.value, y.slope) if type(y) is Dual else (y, 0.0)
        if type(a) in REALS and type(b) in REALS and type(c) is type(d) is float:
            value, rate = function(a, b), slope(a, b, c, d)
            if rate - rate == 0.0:  # finite
                return Dual(value, rate)
        return generic(x, y)

    return of_numbers


ARITHMETIC = {
    "add": _arithmetic(operator.add, lambda a, b, c, d: c + d, _binary(operator.add, "1.0", "1.0")),
    "sub": _arithmetic(
        operator.sub, lambda a, b, c, d: c - d, _binary(operator.sub, "1.0", "-1.0")
    ),
    "mul": _arithmetic(
        operator.mul, lambda a, b, c, d: c * b + a * d, _binary(operator.mul, "b", "a")
    ),
    "truediv": _arithmetic(
        operator.truediv,
        lambda a, b, c, d: (c - a / b * d) / b,
        _binary(operator.truediv, "1.0 / b", "-f / b"),
    ),
    "mod": FUNCTIONS[operator.mod],
    "pow": _raised,
}
for _name, _function in ARITHMETIC.items():
    setattr(Dual, f"__{_name}__", lambda x, y, of=_function: of(x, y))
    setattr(Dual, f"__r{_name}__", lambda y, x, of=_function: of(x, y))
for _name in ("lt", "le", "gt", "ge", "eq", "ne"):
    _compare = getattr(operator, _name)
    setattr(Dual, f"__{_name}__", lambda x, y, of=_compare: of(plain(x), plain(y)))


# --- Rates

WEIGHTS = (-1 / 60, 9 / 60, -45 / 60, 0.0, 45 / 60, -9 / 60, 1 / 60)  # of -3 to 3 steps


def with_rate(value: Any, rate: Any, _like: Any = 0.0) -> Any:
    """Return a number that changes at a rate; compiled code gives it the tangents of another."""
    return Dual(value, rate)


def with_rates(values: Any, rates: Any, _memory: Any) -> Any:
    """Return numbers that change at rates.

    Compiled code puts them into the memory, of twice as many numbers, which `rates` follow.
    """
    return [Dual(values[k], rates[k]) for k in range(len(values))]


def along(function: Any, step: Any, mode: Any, t: Any, y: Any, p: Any) -> Any:
    """Return value and rate of ``function(mode, t, y, p)``, for numbers `t` and `y` with rates.

    The rate of a function that does not take such numbers is a central difference of sixth order
    with this step of time.
    """
    if function not in _refusing:
        try:
            if any(isinstance(each.value, Dual) for each in y):
                t, y = _of_one_order(t, y)
            number = copy_for_tangents(function)(mode, t, y, p)
            changes = _order(number) == _order(t)
            return (number.value, number.slope) if changes else (number, 0.0)
        except (ArithmeticError, ValueError):
            raise
        except Exception:
            result = by_differences(function, step, mode, t, y, p)  # raises errors of its own
            _refusing.add(function)
            return result
    return by_differences(function, step, mode, t, y, p)


_refusing: set[Any] = set()


def _of_one_order(t: Any, y: Any) -> tuple[Any, Any]:
    """Return time and state with tangents in each value and rate, zero where there are none."""
    like = max((each.value for each in y), key=_order)

    def lifted(number: Any) -> Any:
        parts = (number.value, number.slope)
        return Dual(*(x if isinstance(x, Dual) else _constant(float(x), like) for x in parts))

    return lifted(t), getattr(y, "_make", list)([lifted(each) for each in y])


def by_differences(function, step, mode, t, y, p):  # type: ignore[no-untyped-def]
    """Return value and rate of a function of numbers with rates; the rate is a difference."""
    value, rate = 0.0, 0.0
    for k in range(7):
        time = (k - 3) * step
        number = function(mode, after(t, time), after(y, time), p)
        rate += WEIGHTS[k] * number / step
        if k == 3:
            value = number
    return value, rate


def after(given: Any, time: Any) -> Any:
    """Return a number or a state after a time, at its rates."""
    if isinstance(given, Dual):
        return given.value + time * given.slope
    return getattr(given, "_make", list)([after(each, time) for each in given])


copy_for_tangents = Substitution(
    {
        **library.FUNCTIONS,
        **FUNCTIONS,
        **{each: library.FUNCTIONS[each] for each in (math.hypot, math.log)},  # of more arguments
    },
    FUNCTIONS,
    __name__,
).function
"""Return a copy of a function that takes interpreted numbers with tangents."""

# --- Numbers in memory


class DualVector:
    """Numbers with `width` tangents in memory; without any, the numbers are real.

    Each number is followed by its tangents, unless `tangents` names another place: a sequence, an
    index, and the distance from the tangents of one number to those of the next.
    """

    def __init__(
        self,
        memory: Any,
        start: int,
        length: int,
        width: int,
        tangents: tuple[Any, int, int] | None = None,
    ) -> None:
        self._memory, self._start, self._length, self._width = memory, start, length, width
        self._step = 1 + width if tangents is None else 1
        self._tangents = (memory, start + 1, self._step) if tangents is None else tangents

    def __len__(self) -> int:
        return self._length

    size = property(__len__)

    def _places(self, index: int) -> tuple[int, Any, range]:
        """Return where a value is, and its tangents."""
        i, (memory, start, stride) = range(self._length)[index], self._tangents
        first = start + i * stride
        return self._start + i * self._step, memory, range(first, first + self._width)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            start, stop, step = index.indices(self._length)
            if step != 1:
                raise TypeError("a slice with a step")
            memory, first, stride = self._tangents
            tangents = memory, first + start * stride, stride
            begin, length = self._start + start * self._step, max(0, stop - start)
            part = DualVector(self._memory, begin, length, self._width, tangents)
            part._step = self._step
            return part
        i, memory, places = self._places(index)
        value = float(self._memory[i])
        if self._width == 0:
            return value
        return Dual(value, np.array([memory[k] for k in places]))

    def __setitem__(self, index: int, number: Any) -> None:
        if not isinstance(number, Dual | float | int | np.number | np.bool_):
            raise TypeError(f"{type(number).__name__} is no number")
        i, memory, places = self._places(index)
        self._memory[i] = plain(number)
        slope = number.slope if isinstance(number, Dual) else [0.0] * self._width
        for k, each in zip(places, slope, strict=True):
            memory[k] = each
