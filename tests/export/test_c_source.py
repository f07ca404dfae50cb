"""Functions in C give the numbers that they give in Python."""

import ctypes
import functools
import importlib
import math
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.export.c_kinds import BOOLEAN, INTEGER, REAL, Array
from mems_impact.export.c_source import CSource
from mems_impact.export.fmu import find_compiler
from mems_impact.export.function_text import source_of

needs_compiler = pytest.mark.skipif(not find_compiler(), reason="no C compiler")
NODES = (0.5, -0.25, 2.0)
TABLE = np.array([[1.0, 2.0], [3.0, 4.5]])
ARITHMETIC = mi.__path__[0] + "/export/templates"


class Pair(NamedTuple):
    first: float
    second: float = 3.0


def arithmetic(x, y):
    return x // y + x % y - x**3 + y**-2 + abs(x) ** 0.5 + (x if x < y else -y) / 7


def integers(i, j):
    return i // j * 100 + i % j + (i**2 if j > 0 else i & 5) + (i < j) + (i > j)


def loops(x, n):
    total, k = 0, 0
    for i in range(n):
        if i == 3:
            continue
        for weight in NODES:
            total += weight * x**i
            if total > 1e6:
                break
    while True:
        k += 1
        if k >= 4:
            break
    for i, (a, b) in enumerate(zip(NODES, (1, 2, 3))):  # noqa: B905
        total += i * a * b
    return total + k


def swapped(x, y):
    x, y = y, x
    pair = Pair(x)
    first, second = pair
    return first - second * y + pair.second + Pair(second=y, first=2.0).second


def numpy_scalars(x, y):
    first = np.sin(x) + np.hypot(x, y) + np.sign(-x) * np.arctan2(y, x) + np.maximum(x, y)
    second = math.copysign(2.0, -x) + math.floor(x) + round(y) + min(x, y, 0.25) - max(x, y)
    return first + second + float(math.isfinite(x)) + math.tanh(x) * math.log(abs(y), 3)


def arrays(x, y):
    work = np.zeros(3)
    for i in range(3):
        work[i] = NODES[i] * x
    part = work[1:]
    part[-1] += y
    local = np.array([x, y])
    return work[2] + len(part) + work[-2] + TABLE[1, 0] * local[1] + sum(NODES[:2]) + TABLE[0][1]


def of_functions(x, y):
    def_total = 0.0
    for function in (math.cos, squared):
        def_total += function(x)
    return def_total + chosen(None, x) + chosen(squared, y)


def squared(x):
    return x * x


def chosen(function, x):
    if function is None:
        return 1.0
    return function(x)


def keywords(x, /, y):
    return scaled(x, power=2) - scaled(y, 3.0, power=1, shift=x)


def scaled(x, factor=2.0, *, shift=0.5, power):
    return factor * x**power + shift


def logic(x, y):
    inside = (0 < x <= 1.5 and y != 2) or x in (3.0, 4.0)
    return 2.0 * inside + (1 if x is None else 0)


def written(x, y):
    out = np.zeros(4)
    fill(x, out)
    fill(y, out[2:])
    return out[0] + 10.0 * out[1] + 100.0 * out[2] + 1000.0 * out[3]


def fill(x, out):
    out[0], out[1] = x, x + 1.0


def guarded(i, n):
    calls = np.zeros(1)
    first = i < n and 0 <= counted(i, calls) < 5
    second = i < n or 0 <= counted(i, calls) < 5
    return 10.0 * calls[0] + first + 2.0 * second


def counted(i, calls):
    calls[0] += 1.0
    return i


def shifted(x, y):
    out = np.array([x, y, x + y, x - y])
    out[1:] = out[:-1]
    return out[0] + 10.0 * out[1] + 100.0 * out[2] + 1000.0 * out[3]


def widening(x, n):
    """Have the kind of each variable depend on that of the next one, up to a real number."""
    a = b = c = d = e = f = g = h = i = j = k = m = o = q = r = s = t = u = v = w = z = 0
    for _ in range(10 * n):
        (a, b, c, d, e), (f, g, h, i, j) = (b, c, d, e, f), (g, h, i, j, k)
        (k, m, o, q, r), (s, t, u, v, w) = (m, o, q, r, s), (t, u, v, w, z)
        z = x
    return a + b + c + d + e + f + g + h + i + j + k + m + o + q + r + s + t + u + v + w + z


def doubling(function):
    """Return twice a function, under its name."""

    @functools.wraps(function)
    def decorated(x, y):
        return 2.0 * function(x, y)

    return decorated


@doubling
def decorated(x, y):
    return x - y


def shift(x, by):
    return x + by


def shift_2(x):
    return 10.0 * x


def numbered_names(x, y):
    return shift_2(x) + shift(y, 1) + shift(y, 0.5) + shift(2, 1)


def large_integers(x, y):
    return x * 10**23 + y / 2**63 + 2**62


CASES = [
    (arithmetic, REAL), (swapped, REAL), (arrays, REAL), (of_functions, REAL), (logic, REAL),
    (written, REAL), (numpy_scalars, REAL), (integers, INTEGER), (loops, None),
    (shifted, REAL), (guarded, INTEGER), (widening, None), (keywords, REAL),
    (decorated, REAL), (numbered_names, REAL), (large_integers, REAL),
]  # fmt: skip


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    source, exports = CSource(), []
    for function, kind in CASES:
        kinds = (REAL, INTEGER) if kind is None else (kind, kind)
        made = source.function(function, kinds)
        arguments = ", ".join(
            f"{each.ctype} {name}" for each, name in zip(kinds, "ab", strict=True)
        )
        exports.append(
            f"double try_{function.__name__}({arguments}) {{ return {made.name}(a, b); }}"
        )
    folder = tmp_path_factory.mktemp("c")
    text = '#include "arithmetic.h"\n' + source.text() + "\n".join(exports)
    (folder / "all.c").write_text(text)
    command = [*find_compiler(), "-O1", "-Wall", "-Werror", "-Wno-unused", "-std=c11", "-fPIC"]
    command += ["-shared", f"-I{ARITHMETIC}", "all.c", "-o", "all.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "all.so"))


@needs_compiler
@pytest.mark.parametrize(
    ("function", "kind"), CASES, ids=lambda each: getattr(each, "__name__", "")
)
def test_c_gives_the_numbers_of_python(library, function, kind):
    compiled = library[f"try_{function.__name__}"]
    compiled.restype = ctypes.c_double
    first = ctypes.c_int64 if kind == INTEGER else ctypes.c_double
    second = ctypes.c_double if kind == REAL else ctypes.c_int64
    compiled.argtypes = [first, second]
    places = [(0.7, -1.3), (1.5, 2.0), (-2.25, 0.5), (3.0, 4.0)]
    if kind == INTEGER:
        places = [(7, 3), (-7, 3), (7, -3), (2, 9)]
    elif kind is None:
        places = [(0.7, 5), (-1.25, 2), (30.0, 6), (1.0, 0)]
    for place in places:
        assert compiled(*place) == pytest.approx(float(function(*place)), rel=1e-15, abs=1e-15)


def vector_sum(x):
    y = np.zeros(3)
    return y * x


def generator(x):
    return sum(x * each for each in NODES)


def of_scipy(x):
    return np.linalg.norm(x)


def endless(x):
    return endless(x - 1.0)


def changing(x):
    value = 1.0
    if x > 0.0:
        value = (x, x)
    return value


def returned_array(x):
    return np.array([x, 2.0 * x])


def renamed(x):
    total = 0.0
    for function in (math.sin, math.cos):
        total += function(x)
        function = x
    return total


def try_and_catch(x):
    try:
        return 1.0 / x
    except ZeroDivisionError:
        return 0.0


def integer_zeros(x):
    work = np.zeros(2, dtype=int)
    work[0] = x
    return work[0]


def integer_array(x):
    work = np.array([1, 2])
    work[0] = x
    return work[0]


def integer_power(x):
    return x * 10 ** (-1 if x > 0.0 else 1)


def identical(x):
    return 1.0 if (1 if x > 0.0 else 0) is HELD else 0.0


HELD = 1
MEMORY = [0.0, 0.0]


def remembering(x):
    MEMORY[0 if x > 0.0 else 1] = x
    return MEMORY[0]


def of_three(x):
    return math.fsum((x, x, 1.0))


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (integer_zeros, "an array of a type"),
        (integer_array, "an array of integers"),
        (integer_power, "a power of integers with a variable exponent"),
        (identical, "compare them by =="),
        (remembering, "an assignment to an item of a constant"),
        (of_three, "the function math.fsum"),
        (vector_sum, "the operator Mult of an array"),
        (generator, "GeneratorExp"),
        (of_scipy, "norm"),
        (endless, "it is recursive"),
        (changing, "several types"),
        (returned_array, "an array as a result"),
        (renamed, "the variable of a loop"),
        (try_and_catch, "the statement Try"),
    ],
    ids=lambda each: getattr(each, "__name__", ""),
)
def test_what_has_no_translation_is_refused_by_name_and_line(function, said):
    with pytest.raises(mi.FunctionError, match=said) as refusal:
        CSource().function(function, (REAL,))
    error = refusal.value
    assert function.__name__ in str(error)
    assert "test_c_source.py" in str(error)
    first = function.__code__.co_firstlineno
    assert first <= error.line <= first + 6


def test_lambdas_within_longer_expressions():
    given = {
        "first": lambda x: x + 1.0, "second": 2,
    }  # fmt: skip
    nested = functools.partial(
        lambda x, y: (x
                      - y),
    ).func, 3  # fmt: skip
    one, two = lambda x: 2.0 * x, lambda y: 3.0 * y
    for function, count, said in (
        (given["first"], 1, "(v_x + 1.0)"),
        (nested[0], 2, "(v_x - v_y)"),
        (one, 1, "(2.0 * v_x)"),
        (two, 1, "(3.0 * v_y)"),
    ):
        assert f"return {said};" in CSource().function(function, (REAL,) * count).text
    same = (lambda: (lambda x: 2.0 * x, lambda x: 3.0 * x))()
    texts = [CSource().function(each, (REAL,)).text for each in same]
    assert ["2.0 * v_x" in text for text in texts] == [True, False]


@needs_compiler
def test_a_function_without_a_result_gives_no_number(tmp_path):
    def parted(x):
        if x > 0.0:
            return x, 1
        if x < 0.0:
            return -x, 2

    def first(x):
        return parted(x)[0]

    def second(x):
        return parted(x)[1]

    source = CSource()
    names = [source.function(each, (REAL,)).name for each in (first, second)]
    exports = f"double one(double x) {{ return {names[0]}(x); }}\n"
    exports += f"int64_t two(double x) {{ return {names[1]}(x); }}\n"
    (tmp_path / "all.c").write_text('#include "arithmetic.h"\n' + source.text() + exports)
    command = [*find_compiler(), "-std=c11", "-fPIC", "-shared", f"-I{ARITHMETIC}"]
    subprocess.run([*command, "all.c", "-o", "all.so", "-lm"], cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "all.so"))
    library.one.restype, library.two.restype = ctypes.c_double, ctypes.c_int64
    assert library.one(ctypes.c_double(-2.0)) == 2.0
    assert math.isnan(library.one(ctypes.c_double(0.0)))
    assert (library.two(ctypes.c_double(1.0)), library.two(ctypes.c_double(0.0))) == (1, -(2**63))


def test_an_index_out_of_range_is_refused():
    with pytest.raises(mi.FunctionError, match="the index 5 of 2 elements"):
        CSource().function(lambda y: y[5], (Array((2,)),))


def test_conditions_on_constants_are_decided():
    source = CSource()
    assert source.function(chosen, (source_kind(None), REAL)).text.count("return") == 2
    assert source.function(lambda flag: 1.0 if flag else 2.0, (BOOLEAN,)).result == REAL


def source_kind(value):
    from mems_impact.export.c_kinds import Fixed

    return Fixed(value)


@pytest.mark.parametrize("above", ["", "# a line above\n"])
def test_a_file_that_changed_since_its_import_is_refused(tmp_path, monkeypatch, above):
    path = tmp_path / "falling.py"
    path.write_text("def fall(mode, t, y, p):\n    return y.v, -p.g\n")
    monkeypatch.syspath_prepend(tmp_path)
    fall = importlib.import_module("falling").fall
    assert source_of(fall, {}).tree.name == "fall"
    path.write_text(above + "def fall(mode, t, y, p):\n    return y.v, -2.0 * p.g\n")
    with pytest.raises(mi.FunctionError, match=r"fall.*its file has changed since it was imported"):
        source_of(fall, {})
    path.write_text("def fall(mode, t, y, p):\n    return y.v, -p.g\n\n\nMORE = 1\n")
    assert source_of(fall, {}).tree.name == "fall"
    sys.modules.pop("falling")
