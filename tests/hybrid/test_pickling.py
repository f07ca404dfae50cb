"""Comparison of functions."""

import math

from mems_impact.hybrid.pickling import same_function


def shifted(by):
    def function(x):
        return x + by

    return function


def test_functions_are_the_same_by_source_and_captured_values():
    one = shifted(1.0)
    assert same_function(one, one)
    assert same_function(one, shifted(1.0))
    assert not same_function(one, shifted(2.0))
    assert not same_function(one, lambda x: 1.0 - x)
    assert same_function(math.sin, math.sin)
    assert not same_function(math.sin, math.cos)
    assert not same_function(one, math.sin)
