"""Integers and functions of Python's library in C, against those of Python."""

import ctypes
import itertools
import math
import subprocess

import pytest

import mems_impact as mi
from mems_impact.export.c_kinds import INTEGER, REAL
from mems_impact.export.c_source import CSource
from mems_impact.export.fmu import find_compiler

TEMPLATES = mi.__path__[0] + "/export/templates"
REALS = (0.0, -0.0, 1.0, -0.5, 2.5, -7.3, 2.675, 1e16, -1e300, math.inf, math.nan)
INTEGERS = (0, 1, -1, 3, -7, 21, 62, 64, 2**31, 2**53 + 1, -(2**62), 2**63 - 1, -(2**63))
OF_REALS = (
    lambda x, y: math.cbrt(x) + 0.0 * y,
    lambda x, y: math.dist((x, y), (1.0, 2.0)),
    lambda x, y: math.hypot(x, y, 1.0),
    lambda x, y: math.isclose(x, y, rel_tol=0.1),
    lambda x, y: math.log(x, y),
    lambda x, y: math.modf(x)[0] + math.modf(y)[1],
    lambda x, y: math.remainder(x, y),
    lambda x, y: round(x, 2) + round(y, -1),
    lambda x, y: int(x) if y > 0.0 else math.floor(x),
    lambda x, y: any((x, y)) + 2 * all((x > 1.0, y > 1.0)),
    lambda x, y: sum((x, y), 0.5) + math.prod((x, y)),
)
OF_INTEGERS = (
    lambda i, j: i + j,
    lambda i, j: i - j,
    lambda i, j: i * j,
    lambda i, j: -i + abs(j),
    lambda i, j: i // j + i % j,
    lambda i, j: (i << j if j < 99 else 0) + (i >> j),
    lambda i, j: i**3 + j,
    lambda i, j: i / j if j != 0 else 0.0,
    lambda i, j: float(j) < i,
    lambda i, j: math.gcd(i, j) + math.lcm(i, 2),
    lambda i, j: math.comb(i, j) if 0 <= i < 70 and 0 <= j < 70 else 0,
    lambda i, j: math.factorial(i) if i < 70 else j,
)


def outcome(function, *arguments):
    """The value, or None if an exception is raised."""
    try:
        return float(function(*arguments))
    except (ArithmeticError, ValueError):
        return None


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    source, lines = CSource(), []
    for kind, functions in ((REAL, OF_REALS), (INTEGER, OF_INTEGERS)):
        for i, function in enumerate(functions):
            name, c = source.function(function, (kind, kind)).name, kind.ctype
            lines.append(f"double {c}_{i}({c} a, {c} b) {{ return {name}(a, b); }}")
    lines.append("int fault(void) { return take_integer_fault(); }")
    folder = tmp_path_factory.mktemp("c")
    text = '#include "arithmetic.h"\n' + source.text() + "\n".join(lines)
    (folder / "all.c").write_text(text)
    command = [*find_compiler(), "-O1", "-Wall", "-Werror", "-Wno-unused", "-std=c11", "-fPIC"]
    command += ["-shared", f"-I{TEMPLATES}", "all.c", "-o", "all.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "all.so"))


@pytest.mark.skipif(not find_compiler(), reason="no C compiler")
@pytest.mark.parametrize(
    ("kind", "i"),
    [("double", i) for i in range(len(OF_REALS))]
    + [("int64_t", i) for i in range(len(OF_INTEGERS))],
)
def test_c_gives_the_values_of_python_or_a_fault(library, kind, i):
    is_real = kind == "double"
    function, values = (OF_REALS[i], REALS) if is_real else (OF_INTEGERS[i], INTEGERS)
    translated = library[f"{kind}_{i}"]
    translated.restype = ctypes.c_double
    translated.argtypes = [ctypes.c_double if is_real else ctypes.c_int64] * 2
    for arguments in itertools.product(values, values):
        value, right = translated(*arguments), outcome(function, *arguments)
        if library.fault():
            is_small = right is not None and abs(right) < 2**62
            assert not is_small or max(map(abs, arguments)) > 2**53
        elif right is None:
            assert not math.isfinite(value)
        else:
            assert value == pytest.approx(right, rel=2e-15, abs=0.0, nan_ok=True), arguments
