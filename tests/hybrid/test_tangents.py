"""Derivatives of automata against arithmetic of 50 digits."""

import math

import mpmath
import numpy as np
import pytest

import mems_impact as mi
from mems_impact.integrators import dual_numbers
from mems_impact.integrators.dual_numbers import Dual, copy_for_tangents, plain
from mems_impact.integrators.substitution import Substitution
from validation.campaign import automata
from validation.campaign.comparing import ONE
from validation.campaign.drawn import Drawn

NAMES = "sin cos tan asin atan sinh cosh tanh exp log sqrt hypot atan2 floor"


class Exact:
    """A function of mpmath, which is not copied."""

    def __init__(self, call):
        self.call = call

    def __call__(self, *arguments):
        return self.call(*arguments)


FUNCTIONS = {getattr(math, name): Exact(getattr(mpmath, name)) for name in NAMES.split()}
FUNCTIONS |= {
    math.copysign: Exact(lambda a, b: abs(a) if b >= 0 else -abs(a)),
    float: Exact(mpmath.mpf),
}
exact_copies = Substitution(FUNCTIONS, FUNCTIONS, dual_numbers.__name__)


def called(kind, function, automaton, mode, code, numbers):
    """Return the results of a flow, margins or a transition at time, state and parameters."""
    n = len(automaton.states)
    t, y, p = numbers[0], list(numbers[1 : 1 + n]), list(numbers[1 + n :])
    if kind == "transition":
        function(mode, code, t, y, p)
        return y
    results = [[1.0] * max(n, len(automaton.guards)) for _ in range(1 + (kind == "margins"))]
    function(mode, t, y, p, *results)
    return results[0]


def error(kind, automaton, mode, code, numbers, directions):
    """Return the largest error of derivatives by the first numbers, relative to largest terms."""
    function, count = getattr(automaton, kind), directions
    given = (automaton, mode, code)
    seeds = [Dual(v, np.eye(count)[i]) if i < count else v for i, v in enumerate(numbers)]
    results = called(kind, copy_for_tangents(function), *given, seeds)
    assert [plain(each) for each in results] == called(kind, function, *given, list(numbers))
    slopes = [each.slope if isinstance(each, Dual) else np.zeros(count) for each in results]
    terms, step = np.zeros((len(results), count)), mpmath.mpf(10) ** -20
    copy = exact_copies.function(function)
    for i in range(count):
        ends = []
        for h in (step, -step):
            moved = [mpmath.mpf(v) if j < count else v for j, v in enumerate(numbers)]
            moved[i] += h
            ends.append(called(kind, copy, *given, moved))
        terms[:, i] = [(up - down) / (2 * step) for up, down in zip(*ends, strict=True)]
    sizes = np.abs(numbers[:count])
    scale = np.abs(terms * sizes).max(axis=1, keepdims=True)
    apart = np.abs(np.array(slopes) - terms) * sizes
    return float((apart / np.where(scale > 0.0, scale, 1.0)).max())


@pytest.mark.parametrize("number", range(0, 400, 20))
def test_derivatives_of_drawn_automata(number):
    drawn, rng = Drawn(31, number), np.random.default_rng(number)
    flags = (True,) * drawn.m
    automaton = automata.automaton(drawn.n, tuple(drawn.order.tolist()), flags, flags)
    p = automata.parameters(drawn, ONE)
    with mpmath.workdps(50):
        for mode in range(drawn.count):
            numbers = [rng.uniform(0.0, 6.0), *rng.uniform(-1.0, 1.0, drawn.n), *p]
            for kind, codes in (("flow", 1), ("margins", 1), ("transition", drawn.m)):
                for code in range(codes):
                    assert error(kind, automaton, mode, code, numbers, 1 + drawn.n) < 1e-13


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
            assert error("flow", automaton, mode, 0, numbers, len(numbers)) < 1e-13
