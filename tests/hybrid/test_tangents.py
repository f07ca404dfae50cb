"""Derivatives of automata: interpreted, compiled and of 50 digits."""

import mpmath
import numpy as np
import pytest

import mems_impact as mi
from validation.campaign.derivatives import check, error, tangents


@pytest.mark.parametrize("number", range(0, 400, 40))
def test_derivatives_of_drawn_automata(number):
    assert check(31, number).story == ""


@pytest.mark.parametrize("name", ["zhao2004", "mita2003", "abdulrahim2016"])
def test_derivatives_of_devices(name):
    """By parameters, too."""
    drive = mi.Sine(amplitude=0.3, omega=0.5, bias=0.05)
    problem = mi.load_actuator(name).under(drive).problem(mi.Options())
    automaton, rng = problem.automaton, np.random.default_rng(5)
    with mpmath.workdps(50):
        for mode in range(len(automaton.modes)):
            y = rng.uniform(-0.45, 0.45, len(automaton.states))
            numbers = [rng.uniform(0.1, 5.0), *y, *problem.parameters]
            numbers = [float(each) for each in numbers]
            given = "flow", automaton, mode, 0, numbers
            assert error(*given, tangents(*given, len(numbers))) < 1e-13
