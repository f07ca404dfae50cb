"""Runs, an orbit and branches that several figures are drawn of."""

import pytest

import mems_impact as mi
from tests.analysis.systems import ball, oscillator


@pytest.fixture(scope="session")
def run():
    """The oscillator: one impact a period."""
    return mi.simulate(oscillator(), 100)


@pytest.fixture(scope="session")
def resting():
    """The oscillator, pressed against its wall after a sequence of impacts in each period."""
    return mi.simulate(oscillator().changed(A=1.6, omega=0.25, e=0.5), 20)


@pytest.fixture(scope="session")
def falling():
    """A ball without forcing, with units."""
    return mi.simulate(ball(parameters={"g": 9.81, "e": 0.8}), duration=3.0)


@pytest.fixture(scope="session")
def orbit(run):
    """The oscillator's orbit with one impact a period."""
    return mi.find_orbit(run, transient=100)


@pytest.fixture(scope="session")
def branch(orbit):
    """From A = 0.6 down through a period doubling and a grazing."""
    return mi.continue_solution(orbit, "A", 0.34)
