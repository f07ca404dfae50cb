"""Verilog-A statements against the Python functions that they translate."""

import ast
import math
import re

import numpy as np
import pytest

from mems_impact._util.units import DIMENSIONLESS
from mems_impact.actuator.verilog_a import SPLINES, accelerations_of, layout_of, load_of
from mems_impact.errors import FunctionError
from mems_impact.export.verilog_a import VerilogStatements, text_of
from tests.actuator.test_verilog_a import ALL, DIFFERENT, SMOOTH

FUNCTIONS = {name: getattr(math, name) for name in ("sqrt", "exp", "sin", "cos", "tanh", "atanh")}
FUNCTIONS |= {"ln": math.log, "pow": math.pow, "abs": abs, "min": min, "max": max}


def executed(code, value, numbers):
    """Return the value of statements, executed by Python."""
    lines = []
    for line in code.lines:
        line = re.sub(r"^(\s*)if \((.*?)\) (?=begin$|\w+ =)", r"\1if \2: ", line)
        line = re.sub(r"^(\s*)else ", r"\1else: ", line)
        line = line.replace("&&", "and").replace("||", "or").rstrip(";")
        if line.strip() != "end":
            lines.append(re.sub(r" begin$", "", line))
    space = {**FUNCTIONS, **numbers}
    exec("\n".join(lines), space)
    return eval(text_of(value), space)


def translated(function, *arguments):
    """Return the value of a translated function of numbers, and that of the function."""
    code = VerilogStatements(())
    names = [f"x{i}" for i in range(len(arguments))]
    value = code.call(function, *map(ast.Name, names))
    return executed(code, value, dict(zip(names, arguments, strict=True))), function(*arguments)


def branches(x, y):
    if x > 1.0 and y > 0.0:
        return x * x
    z = 1.0
    if y < 0.0:
        z = -y
        z *= 2.0
    return math.log(z + x**2) - (y if x < 0.5 else x**3)


def loop(x, y):
    total = 0.0
    for k in range(1, 4):
        total += x**k / k
    first, second = total, y
    return first - max(second, 0.0) ** 1.5


@pytest.mark.parametrize("function", [branches, loop])
@pytest.mark.parametrize("x", [0.2, 0.7, 1.5])
@pytest.mark.parametrize("y", [-2.0, 0.0, 0.3])
def test_statements_compute_what_a_function_returns(function, x, y):
    found, expected = translated(function, x, y)
    assert found == pytest.approx(expected, rel=1e-14)


def endless(x):
    while x > 1.0:
        x = 0.5 * x
    return x


def test_what_has_no_form_is_refused_with_its_place():
    with pytest.raises(FunctionError, match="cannot be translated to Verilog-A: While") as caught:
        VerilogStatements(()).call(endless, ast.Name("x"))
    assert caught.value.file == __file__


@pytest.mark.parametrize(
    ("device", "electrodes"), [(SMOOTH, 1), (ALL, 1), (DIFFERENT, 2)], ids=["plain", "all", "two"]
)
def test_equations_of_a_device(device, electrodes):
    layout = layout_of(device, electrodes)
    model, states = layout.model, layout.model.layout.states
    p = [*device.to_array().tolist()]
    p += (number for term in device.terms for number in term.numbers(DIMENSIONLESS))
    names = {each.id: number for each, number in zip(list(layout.p), p, strict=True)
             if isinstance(each, ast.Name)}  # fmt: skip
    code = VerilogStatements(layout.symbols, SPLINES)
    at = ast.Name("v"), ast.Name("w"), layout.y, layout.p
    load = code.call(load_of(model), *at)
    a1 = code.call(accelerations_of(model)[0], load, 0.0, *at[2:])
    kept = [i - 4 for i in range(4, len(states)) if i not in model.cyclic]
    values = ast.Tuple([load, a1, *(code.call(model.rates[i], *at) for i in kept)])
    rng = np.random.default_rng(0)
    sizes = np.array([1e-6, 1e-3, 4.0 * device.delta / 3.0, 1e-3, *[1e-8] * (len(states) - 4)])
    for _ in range(20):
        y = (sizes * rng.uniform(-1.0, 1.0, len(states))).tolist()
        v, w = rng.uniform(-30.0, 30.0, 2).tolist()
        numbers = names | dict(zip(states, y, strict=True), v=v, w=w)
        found = executed(code, values, numbers)
        inner = load_of(model)(v, w, y, p)
        expected = [inner, accelerations_of(model)[0](inner, 0.0, y, p)]
        expected += (model.rates[i](v, w, y, p) for i in kept)
        assert found == pytest.approx(expected, rel=1e-10, abs=1e-300)
