"""Variables without a value on some path: compiled functions against Python."""

import pytest
from numba import njit

from mems_impact.integrators.jit.closures import take_snapshot
from mems_impact.integrators.jit.numba_support import JIT


def branch(x):
    if x > 0.0:
        z = x
    return 2.0 * z


def two_branches(x):
    if x > 0.0:
        z = 1.0
    elif x < -1.0:
        z = 2.0
    if x > 0.0:
        return z
    return 3.0 if x > -1.0 else z


def loop(x):
    for i in range(int(x)):
        z = i * x
    return z + i


def while_loop(x):
    while x > 1.0:
        x, z = 0.5 * x, x
    return z


def augmented(x):
    if x > 0.0:
        total = 0.0
    for i in range(3):
        total += i * x
    return total


def helper(x):
    return branch(x) + branch(x + 1.0)


FUNCTIONS = (branch, two_branches, loop, while_loop, augmented, helper)


@pytest.mark.quick(3)
@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
def test_a_read_of_a_variable_without_a_value_raises(function):
    compiled, raised = njit(**JIT)(take_snapshot(function).frozen()[0]), 0
    for x in (-2.0, -0.5, 0.5, 2.5, 7.0):
        try:
            right = function(x)
        except UnboundLocalError:
            raised += 1
            with pytest.raises(UnboundLocalError):
                compiled(x)
        else:
            assert compiled(x) == right
    assert raised < 5
