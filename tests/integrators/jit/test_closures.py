"""What a function draws on: all of it is in the name, whatever way it is reached."""

import math
import textwrap
from dis import get_instructions
from enum import IntEnum
from types import FunctionType, ModuleType

import numpy as np
import pytest
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from mems_impact.hybrid.attractors import recurrence
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.event_loop import loop
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational import saltation
from mems_impact.integrators.jit import closures
from mems_impact.integrators.jit.closures import take_snapshot
from mems_impact.integrators.options import Options


def function(source, **space):
    """The function `f` of a source, among the globals given."""
    space = {"math": math, **space}
    exec(textwrap.dedent(source), space)
    return space["f"]


def name(source, **space):
    return take_snapshot(function(source, **space)).name


def module(**attributes):
    made = ModuleType("constants")
    vars(made).update(attributes)
    return made


class Side(IntEnum):
    LEFT = 0
    RIGHT = 1


def test_an_attribute_is_no_global_of_the_same_name():
    source = "def f(p):\n    return p.e"
    assert name(source) == name(source, e=object())
    assert take_snapshot(function(source, e=object())).lasting


READS = "def f():\n    return RATE"
ATTRIBUTE = "def f():\n    return constants.RATE"
INNER_ATTRIBUTE = "def f():\n    return package.constants.RATE"
CALLEE = """
    def inner():
        return RATE
    def f():
        return inner()
"""
CLOSED_OVER = """
    def outer(rate):
        def inner():
            return rate
        return inner
    inner = outer(RATE)
    def f():
        return inner()
"""
DEFAULT = """
    def inner(*, rate=RATE):
        return rate
    def f(inner=inner):
        return inner()
"""
IN_A_TUPLE = """
    def inner():
        return RATE
    both = (inner, (1, inner))
    def f():
        return both[1][1]()
"""
WITHIN = """
    def f():
        return sum([RATE for _ in range(3)])
"""
MUTUAL = """
    def even(n):
        return True if n == 0 else odd(n - RATE)
    def odd(n):
        return False if n == 0 else even(n - RATE)
    f = even
"""


@pytest.mark.parametrize(
    "source",
    [READS, CALLEE, CLOSED_OVER, DEFAULT, IN_A_TUPLE, WITHIN, MUTUAL],
    ids=["global", "callee", "closure", "default", "tuple", "comprehension", "recursion"],
)
@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1.0, 2.0),
        (1.0, 1),
        (0.0, -0.0),
        (True, 1),
        ((1.0, (2.0, 3.0)), (1.0, (2.0, 4.0))),
        ((1.0, (2.0, 3.0)), (1.0, 2.0, 3.0)),
        ("on", "off"),
        (Side.LEFT, Side.RIGHT),
        (np.array([1.0, 2.0]), np.array([1.0, 3.0])),
        (np.zeros((2, 3)), np.zeros((3, 2))),
        (np.zeros(2), np.zeros(2, dtype=np.int64)),
        (np.float32(1.0), np.float64(1.0)),
        (math.sin, math.cos),
    ],
    ids=repr,
)
def test_numbers_are_in_the_name(source, one, other):
    assert name(source, RATE=one) == name(source, RATE=one)
    assert name(source, RATE=one) != name(source, RATE=other)
    assert take_snapshot(function(source, RATE=one)).lasting


def test_attributes_of_modules_are_in_the_name():
    assert name(ATTRIBUTE, constants=module(RATE=1.0)) != name(
        ATTRIBUTE, constants=module(RATE=2.0)
    )
    packages = [ModuleType("package") for _ in range(2)]
    for package, rate in zip(packages, (1.0, 2.0), strict=True):
        package.constants = module(RATE=rate)
        package.constants.package = package  # a circle
    assert name(INNER_ATTRIBUTE, package=packages[0]) != name(INNER_ATTRIBUTE, package=packages[1])


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("def f(x):\n    return x + 1.0", "def f(x):\n    return x + 2.0"),
        ("def f(x):\n    return x + 1.0", "def f(x):\n    return x - 1.0"),
        ("def f(x):\n    return math.sin(x)", "def f(x):\n    return math.cos(x)"),
        ("def f(x):\n    return g(a=x)\ng = f", "def f(x):\n    return g(b=x)\ng = f"),
    ],
)
def test_code_is_in_the_name(one, other):
    assert name(one) != name(other)


def test_where_a_function_stands_is_not_in_the_name():
    assert name(READS, RATE=1.0) == name("\n\n\n" + READS, RATE=1.0, UNREAD=2.0)


def test_what_cannot_be_determined_is_no_lasting_name():
    one, other = (take_snapshot(function(READS, RATE=object())) for _ in range(2))
    assert not one.lasting
    assert one.name != other.name


INTRINSIC = """
    @intrinsic
    def rate(typing, x):
        def codegen(context, builder, signature, args):
            return ir.Constant(REAL, RATE)
        return types.float64(x), codegen
    def f(x):
        return rate(x)
"""


def test_the_definition_of_an_intrinsic_is_in_the_name():
    space = {"intrinsic": intrinsic, "ir": ir, "types": types, "REAL": ir.DoubleType()}
    assert name(INTRINSIC, RATE=1.0, **space) == name(INTRINSIC, RATE=1.0, **space)
    assert name(INTRINSIC, RATE=1.0, **space) != name(INTRINSIC, RATE=2.0, **space)
    single = {**space, "REAL": ir.FloatType()}
    assert name(INTRINSIC, RATE=1.0, **space) != name(INTRINSIC, RATE=1.0, **single)


LOOPS = (
    loop.run_steps, recurrence.map_points, saltation.propagate_segments,
    saltation.stretch, saltation.reset, saltation.constrain, saltation.flow_at,
)  # fmt: skip


@pytest.mark.parametrize("each", LOOPS, ids=lambda each: each.__name__)
def test_the_code_of_every_loop_is_kept(each):
    assert take_snapshot(each).lasting


def test_a_change_is_seen():
    constants, array = module(RATE=1.0), np.array([1.0])
    f = function("def f(x=1.0):\n    return constants.RATE", constants=constants)
    g = function(READS, RATE=array)
    names = {take_snapshot(f).name}
    assert {take_snapshot(f).name} == names
    constants.RATE = 2.0
    names.add(take_snapshot(f).name)
    f.__defaults__ = (2.0,)
    names.add(take_snapshot(f).name)
    f.__globals__["constants"] = module(RATE=3.0)
    names.add(take_snapshot(f).name)
    assert len(names) == 4
    before = take_snapshot(g)
    array[0] = 2.0
    assert take_snapshot(g) != before


GAIN = 1.0
constants = module(RATE=1.0)
TABLE = np.array([1.0])


def _gain():
    return GAIN


def _flow(mode, t, y, p, dy):
    dy[0] = _gain()
    dy[1] = constants.RATE
    dy[2] = TABLE[0]


def _margins(mode, t, y, p, g, r):
    g[0] = 1.0


def _transition(mode, code, t, y, p):
    return mode


RAMPS = Automaton(
    states=("a", "b", "c"),
    modes=("m",),
    guards=(Guard(name="never", order=0),),
    flow=_flow,
    margins=_margins,
    transition=_transition,
)


def ramps():
    problem = Problem(
        automaton=RAMPS, parameters=[0.0], period=1.0, options=Options(engine="compiled")
    )
    return run(problem, HybridState(0, 0.0, 0, np.zeros(3)), 1.0).final.y


def test_values_that_change_in_place():
    def outer(rate):
        def scaled(x, *, factor=2.0, table=None):
            return x if rate is None else factor * table[0][0] * x

        def set_rate(value):
            nonlocal rate
            rate = value

        return scaled, set_rate

    scaled, set_rate = outer(None)
    scaled.__kwdefaults__["table"] = (np.array([1.0]),)
    nested = function("def f(x):\n    def g(v):\n        return h(v)\n    return g(x)", h=scaled)
    changes = (
        lambda: set_rate(1.0),
        lambda: scaled.__kwdefaults__.update(factor=5.0),
        lambda: scaled.__kwdefaults__["table"][0].fill(7.0),
        lambda: setattr(scaled, "__kwdefaults__", {"factor": 3.0, "table": (np.ones(1),)}),
    )
    for each in (scaled, nested):
        names = [take_snapshot(each).name]
        for change in changes:
            change()
            names.append(take_snapshot(each).name)
        assert len(set(names)) == len(names)
        set_rate(None)
        scaled.__kwdefaults__ = {"factor": 2.0, "table": (np.array([1.0]),)}


def test_numbers_that_change_between_two_runs(monkeypatch):
    assert ramps() == pytest.approx([1.0, 1.0, 1.0])
    monkeypatch.setitem(globals(), "GAIN", 2.0)
    assert ramps() == pytest.approx([2.0, 1.0, 1.0])
    monkeypatch.setattr(constants, "RATE", 3.0)
    try:
        TABLE[0] = 4.0
        assert ramps() == pytest.approx([2.0, 3.0, 4.0])
    finally:
        TABLE[0] = 1.0
    monkeypatch.undo()
    assert ramps() == pytest.approx([1.0, 1.0, 1.0])


def test_names_of_globals_are_those_of_the_disassembly():
    for value in vars(loop).values():
        if isinstance(value, FunctionType):
            code = value.__code__
            read = {step.argval for step in get_instructions(code) if step.opname == "LOAD_GLOBAL"}
            assert set(closures._names_of_globals(code)) == read
