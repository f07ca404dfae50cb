"""Functions of an automaton as C functions: compiled one by one, with a record of failures."""

import ctypes
import math

import numpy as np
import pytest
from numba.core.caching import NullCache
from numba.core.errors import TypingError

from mems_impact.integrators.jit import kernel_code
from mems_impact.integrators.jit.closures import take_snapshot
from mems_impact.integrators.jit.kernels import kernels
from mems_impact.integrators.python_functions import (
    FLOW,
    HEAD,
    MARGINS,
    NO_MODE,
    TRANSITION,
    recorded_fault,
)

N, M = 2, 3
TEXT = """
def shared(y, p):
    return p[0] * y[0]

def flow(mode, t, y, p, dy):
    if mode == 7:
        raise ValueError
    dy[0] = shared(y, p)

def margins(mode, t, y, p, g, r):
    g[0] = shared(y, p)
    r[1] = t
    if mode == 7:
        g[p.size + mode] = 0.0

def transition(mode, code, t, y, p):
    y[0] = -y[0]
    if mode == 7:
        raise ValueError
    return mode + code
"""


def functions(text=TEXT):
    space = {}
    exec(text, space)
    return [space[name] for name in ("flow", "margins", "transition")]


class Memory:
    """The arrays of a call, and the record of a fault after the parameters."""

    def __init__(self):
        self.y = np.array([3.0, 5.0])
        self.block = np.array([2.0, *[0.0] * (HEAD + N)])
        self.out = np.zeros(2 * M)

    def call(self, kernel, mode, code=0, t=0.5):
        word, real = ctypes.c_int64, ctypes.c_double
        call = ctypes.CFUNCTYPE(word, word, word, real, word, word, word, word)(kernel.address)
        return call(
            mode, code, t, self.y.ctypes.data, self.block.ctypes.data, 1, self.out.ctypes.data
        )

    @property
    def fault(self):
        return recorded_fault(self.block[1:])


@pytest.fixture(scope="module")
def compiled():
    return kernels(*functions(), N, M)


def test_the_values_of_calls(compiled):
    memory = Memory()
    assert memory.call(compiled.flow, 1) == 1
    np.testing.assert_array_equal(memory.out[:N], [6.0, math.nan])  # dy[1] is not written
    assert memory.call(compiled.margins, 1) == 1
    np.testing.assert_array_equal(memory.out, [6.0, 1.0, 1.0, 1.0, 0.5, 1.0])
    assert memory.call(compiled.transition, 1, 4) == 5
    np.testing.assert_array_equal(memory.y, [-3.0, 5.0])
    assert memory.fault is None


@pytest.mark.parametrize(
    ("name", "role", "value", "out"),
    [
        ("flow", FLOW, 7, [math.nan] * N),
        ("margins", MARGINS, 7, [math.nan] * M),
        ("transition", TRANSITION, NO_MODE, []),
    ],
)
def test_a_failed_call_is_recorded_and_leaves_the_state(compiled, name, role, value, out):
    memory = Memory()
    assert memory.call(getattr(compiled, name), 7, 2) == value
    np.testing.assert_array_equal(memory.out[: len(out)], out)
    np.testing.assert_array_equal(memory.y, [3.0, 5.0])
    fault = memory.fault
    assert fault[:4] == (role, 7, 2, 0.5)
    np.testing.assert_array_equal(fault.y, [3.0, 5.0])


def test_the_first_failure_is_kept(compiled):
    memory = Memory()
    memory.call(compiled.flow, 7)
    memory.y[0] = 4.0
    memory.call(compiled.margins, 7)
    assert memory.call(compiled.transition, 7) == NO_MODE
    assert memory.fault.role == FLOW
    np.testing.assert_array_equal(memory.fault.y, [3.0, 5.0])


def test_an_edit_compiles_the_functions_that_depend_on_it(compiled, monkeypatch):
    names = []
    link = kernel_code._link

    def counted(function, arguments, body, name, *others):
        names.append(name.partition("_")[0])
        return link(function, arguments, body, name, *others)

    monkeypatch.setattr(kernel_code, "_link", counted)
    monkeypatch.setattr(kernel_code, "library_cache", lambda *_: NullCache())
    equal = kernels(*functions(), N, M)
    assert equal == compiled
    edited = kernels(*functions(TEXT.replace("r[1] = t", "r[1] = 2.0 * t")), N, M)
    assert names == ["margins"]
    assert (edited.flow, edited.transition) == (compiled.flow, compiled.transition)
    memory = Memory()
    memory.call(edited.margins, 1)
    assert memory.out[4] == 1.0
    kernels(*functions(TEXT.replace("p[0] * y[0]", "y[0] * p[0]")), N, M)
    assert names == ["margins", "flow", "margins"]


def test_snapshots_share_copies_of_equal_functions():
    (flow, *_), (_, margins, _) = functions(), functions()
    one, other = take_snapshot(flow).frozen()[0], take_snapshot(margins).frozen()[0]
    assert one.__globals__["shared"] is other.__globals__["shared"]
    checked = take_snapshot(flow).frozen(boundscheck=True)[0]
    assert checked.__globals__["shared"] is not one.__globals__["shared"]
    (changed, *_) = functions(TEXT.replace("p[0] * y[0]", "p[0] + y[0]"))
    assert take_snapshot(changed).frozen()[0].__globals__["shared"] is not one.__globals__["shared"]


@pytest.mark.parametrize("returned", ["None", "mode if mode else None", "1j"])
def test_a_transition_must_return_a_mode(returned):
    with pytest.raises(TypingError):
        kernels(*functions(TEXT.replace("return mode + code", f"return {returned}")), N, M)


@pytest.mark.parametrize(("returned", "value"), [("mode > 0", 1), ("2.0 * mode", 2)])
def test_numbers_that_stand_for_a_mode(returned, value):
    changed = functions(TEXT.replace("return mode + code", f"return {returned}"))
    assert Memory().call(kernels(*changed, N, M).transition, 1) == value
