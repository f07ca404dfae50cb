"""C functions and operators in place of those of Python, math and NumPy."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from mems_impact.export.c_kinds import BOOLEAN, INTEGER, REAL, Scalar

# C functions of real arguments with a real result, by the Python functions that they replace.
REAL_FUNCTIONS: dict[Any, str] = {
    getattr(math, name): name
    for name in (
        *("acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "copysign", "cos", "cosh"),
        *("erf", "erfc", "exp", "expm1", "fabs", "fmod", "hypot", "lgamma", "log10", "log1p"),
        *("log2", "nextafter", "pow", "remainder", "sin", "sinh", "sqrt", "tan", "tanh"),
    )
}
REAL_FUNCTIONS |= {
    math.gamma: "tgamma",
    math.ldexp: "scaled",
    math.degrees: "to_degrees",
    math.radians: "to_radians",
    np.abs: "fabs",
    np.arccos: "acos",
    np.arccosh: "acosh",
    np.arcsin: "asin",
    np.arcsinh: "asinh",
    np.arctan: "atan",
    np.arctan2: "atan2",
    np.arctanh: "atanh",
    np.cbrt: "cbrt",
    np.ceil: "ceil",
    np.copysign: "copysign",
    np.cos: "cos",
    np.cosh: "cosh",
    np.deg2rad: "to_radians",
    np.degrees: "to_degrees",
    np.exp: "exp",
    np.exp2: "exp2",
    np.expm1: "expm1",
    np.fabs: "fabs",
    np.floor: "floor",
    np.fmod: "fmod",
    np.heaviside: "heaviside",
    np.hypot: "hypot",
    np.log: "log",
    np.log10: "log10",
    np.log1p: "log1p",
    np.log2: "log2",
    np.maximum: "greater",
    np.minimum: "lesser",
    np.nextafter: "nextafter",
    np.power: "pow",
    np.rad2deg: "to_degrees",
    np.radians: "to_radians",
    np.rint: "rint",
    np.sign: "sign_of",
    np.sin: "sin",
    np.sinh: "sinh",
    np.sqrt: "sqrt",
    np.square: "square",
    np.tan: "tan",
    np.tanh: "tanh",
    np.trunc: "trunc",
}
OF_TWO = {"atan2", "copysign", "fmod", "greater", "heaviside", "hypot", "lesser", "nextafter"}
OF_TWO |= {"pow", "remainder", "scaled"}  # C functions of two arguments
INTEGER_FUNCTIONS: dict[Any, str] = {
    math.ceil: "ceil",
    math.floor: "floor",
    math.trunc: "trunc",
    round: "rint",
}
TESTS: dict[Any, str] = {
    math.isfinite: "isfinite",
    math.isinf: "isinf",
    math.isnan: "isnan",
    np.isfinite: "isfinite",
    np.isinf: "isinf",
    np.isnan: "isnan",
    np.signbit: "signbit",
}
CASTS: dict[Any, Scalar] = {
    bool: BOOLEAN,
    float: REAL,
    int: INTEGER,
    np.float64: REAL,
    np.int64: INTEGER,
    np.bool_: BOOLEAN,
}
BINARY: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.BitAnd: operator.and_,
    ast.BitOr: operator.or_,
    ast.BitXor: operator.xor,
    ast.LShift: operator.lshift,
    ast.RShift: operator.rshift,
}
UNARY: dict[type, Callable[[Any], Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Invert: operator.invert,
}
SIGNS: dict[type, str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.BitAnd: "&",
    ast.BitOr: "|",
    ast.BitXor: "^",
    ast.LShift: "<<",
    ast.RShift: ">>",
}
# Operators of integers whose results may need more bits.
CHECKED = {
    ast.Add: "sum_i",
    ast.Sub: "difference_i",
    ast.Mult: "product_i",
    ast.LShift: "left_i",
    ast.RShift: "right_i",
}
COMPARISONS: dict[type, tuple[Callable[..., Any], str]] = {
    ast.Eq: (operator.eq, "=="),
    ast.NotEq: (operator.ne, "!="),
    ast.Lt: (operator.lt, "<"),
    ast.LtE: (operator.le, "<="),
    ast.Gt: (operator.gt, ">"),
    ast.GtE: (operator.ge, ">="),
}
LARGEST_POWER = 16  # of an integer exponent that is multiplied out
