"""Sine and cosine of compiled code, in place of the C library's.

On processors with a fused multiply-add they are part of the compiled function, so that no call
interrupts it: the argument is reduced by three parts of pi/2 (Cody and Waite), and the kernels are
the polynomials of fdlibm on [-pi/4, pi/4], with the rounding error of the reduced argument. Their
error is below one unit in the last place. Elsewhere, and for zeros, infinities, NaN and arguments
beyond `LARGEST_ARGUMENT`, the C library computes them.

Sources: W. J. Cody and W. Waite, "Software Manual for the Elementary Functions", Prentice-Hall,
1980; fdlibm 5.3, ``k_sin.c`` and ``k_cos.c``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.registry import cpu_target
from numba.extending import intrinsic, overload

from mems_impact.integrators.jit.integer_arithmetic import OF_REALS
from mems_impact.integrators.jit.numba_support import FOR_C, INNER

LARGEST_ARGUMENT = 1e9  # rad, up to which three parts of pi/2 suffice

HALF_PI = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33)
SHIFTER = 6755399441055744.0  # 1.5 * 2^52: a sum with it is rounded to an integer
SINE = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
COSINE = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip

DOUBLE, WORD = ir.DoubleType(), ir.IntType(64)


def cos(x: float) -> float:
    """Return the cosine."""
    return math.cos(x)


def sin(x: float) -> float:
    """Return the sine."""
    return math.sin(x)


class Reduction:
    """LLVM instructions for an argument reduced to a quadrant and an angle in [-pi/4, pi/4].

    `tail` is the rounding error of the angle, `square` its square.
    """

    def __init__(self, builder: Any, x: Any) -> None:
        kind = ir.FunctionType(DOUBLE, [DOUBLE] * 3)
        self._fma = cgutils.get_or_insert_function(builder.module, kind, "llvm.fma.f64")
        self._builder = builder
        rounded = self.fma(x, DOUBLE(2.0 / math.pi), DOUBLE(SHIFTER))
        count = builder.fsub(rounded, DOUBLE(SHIFTER))
        first, second, third = (DOUBLE(-part) for part in HALF_PI)
        remainder = self.fma(count, first, x)  # exact
        product = builder.fmul(count, second)
        self.angle = builder.fadd(remainder, product)
        # The error of this sum (Knuth's TwoSum), that of the product, and the third part.
        increment = builder.fsub(self.angle, remainder)
        error = builder.fadd(
            builder.fsub(remainder, builder.fsub(self.angle, increment)),
            builder.fsub(product, increment),
        )
        error = builder.fadd(error, self.fma(count, second, builder.fneg(product)))
        self.tail = self.fma(count, third, error)
        self.quadrant = builder.bitcast(rounded, WORD)
        self.square = builder.fmul(self.angle, self.angle)

    def fma(self, a: Any, b: Any, c: Any) -> Any:
        """Return a b + c, rounded once."""
        return self._builder.call(self._fma, [a, b, c])

    def polynomial(self, c: tuple[float, ...], fourth: Any) -> Any:
        """Return a polynomial of degree five in the square, by Estrin's scheme."""
        low, middle, high = (
            self.fma(DOUBLE(c[i + 1]), self.square, DOUBLE(c[i])) for i in (0, 2, 4)
        )
        return self.fma(fourth, self.fma(fourth, high, middle), low)

    def value(self, quarter_turns: int) -> Any:
        """Return the sine of the argument advanced by quarter turns."""
        b, r, tail, z = self._builder, self.angle, self.tail, self.square
        fourth, half = b.fmul(z, z), b.fmul(z, DOUBLE(0.5))
        # sin(r + tail) = r + (r z S(z) + tail (1 - z/2))
        weight = b.fsub(DOUBLE(1.0), half)
        cubic = b.fmul(b.fmul(r, z), self.polynomial(SINE, fourth))
        sine = b.fadd(r, self.fma(tail, weight, cubic))
        # cos(r + tail) = weight + (error of weight + z z C(z) - r tail)
        error = b.fsub(b.fsub(DOUBLE(1.0), weight), half)
        error = self.fma(b.fneg(r), tail, error)
        cosine = b.fadd(weight, self.fma(fourth, self.polynomial(COSINE, fourth), error))
        turns = b.add(self.quadrant, WORD(quarter_turns))
        result = b.select(b.trunc(turns, ir.IntType(1)), cosine, sine)
        sign = b.shl(b.and_(turns, WORD(2)), WORD(62))
        return b.bitcast(b.xor(b.bitcast(result, WORD), sign), DOUBLE)


def _advanced_sine(quarter_turns: int) -> Any:
    @intrinsic
    def compute(_typing: Any, x: Any) -> Any:
        def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            return Reduction(builder, args[0]).value(quarter_turns)

        return types.float64(types.float64), codegen

    return compute


def has_fma() -> bool:
    """Return whether the processor that code is compiled for has a fused multiply-add."""
    triple, _, features = cpu_target.target_context.codegen().magic_tuple()
    return triple.startswith(("aarch64", "arm64")) or "+fma," in f"{features},"


_sine, _cosine = _advanced_sine(0), _advanced_sine(1)


def _overload(
    stand_in: Callable[..., Any], library: Callable[[float], float], compute: Any
) -> None:
    @overload(stand_in, jit_options={**FOR_C, **INNER}, strict=False)
    def _compiled(x: Any) -> Any:
        if not isinstance(x, types.Number):
            return None
        if x != types.float64 or not has_fma():
            return lambda x: library(x)

        def implementation(x):  # type: ignore[no-untyped-def]
            # Without a condition, so that LLVM reduces an argument of several functions once.
            value = compute(x)
            if not 0.0 < abs(x) < LARGEST_ARGUMENT:
                value = library(x)
            return value

        return implementation


_overload(sin, OF_REALS[math.sin], _sine)
_overload(cos, OF_REALS[math.cos], _cosine)

SUBSTITUTES: dict[Any, Callable[..., Any]] = {math.sin: sin, math.cos: cos}
"""Functions of compiled code, by Python's."""
