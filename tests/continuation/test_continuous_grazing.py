"""A guard that is touched where only the flow changes: followed through from both sides.

A mass on a spring, driven by A cos(t + phase), with a second spring beyond x = 1. Without it x is
A / |2 - 1 + 0.2 i| at the most, so that it is touched where that is 1.
"""

import cmath
import math

import pytest

import mems_impact as mi

FREE, PRESSED = mi.modes("free", "pressed")
GRAZING = math.hypot(1.0, 0.2)


def flow(mode, t, y, p):
    force = p.A * math.cos(t + p.phase) - 0.2 * y.v - 2.0 * y.x
    return (y.v, force) if mode == FREE else (y.v, force - p.k * (y.x - 1.0))


def gap(mode, t, y, p):
    return 1.0 - y.x


def press(mode, t, y, p):
    return PRESSED, (y.x, y.v)


def depth(mode, t, y, p):
    return y.x - 1.0


def release(mode, t, y, p):
    return FREE, (y.x, y.v)


SPRINGS = mi.System(
    states=("x", "v"),
    flow=flow,
    period=2.0 * math.pi,
    parameters={"A": 1.0, "k": 5.0, "phase": 1.0},
    guards=[
        mi.Guard("contact", gap, press, modes=(FREE,)),
        mi.Guard("release", depth, release, modes=(PRESSED,)),
    ],
)


def through(system, start, stop):
    orbit = mi.find_orbit(system.changed(A=start), transient=100)
    return mi.continue_solution(orbit, "A", stop)


def check_through(branch, phase, *, inwards):
    (touched,) = branch.special_points
    assert touched.kind == "contact"
    assert touched.value == pytest.approx(GRAZING, abs=1e-9)
    assert branch.ended == "A reached its bound"
    assert branch.table["admissible"].all()
    # Of the linear oscillator: the second spring is not yet felt.
    decay = cmath.exp(2.0 * math.pi * complex(-0.1, math.sqrt(1.99)))
    found = sorted(touched.orbit.multipliers, key=lambda value: value.imag)
    assert found == pytest.approx([decay.conjugate(), decay], abs=1e-5)
    largest = branch.special_table["largest multiplier"].to_list()
    assert largest == pytest.approx([abs(decay)], abs=1e-5)
    touches = [len(orbit.events) for orbit in (branch.orbits[0], branch.orbits[-1])]
    assert touches == ([0, 2] if inwards else [2, 0])
    free = branch.orbits[0 if inwards else -1]
    response = free.system.parameters["A"] * cmath.exp(1j * phase) / (1.0 + 0.2j)
    assert free.state.x == pytest.approx(response.real, abs=1e-9)
    assert free.state.v == pytest.approx(-response.imag, abs=1e-9)


@pytest.mark.slow
def test_from_the_side_with_the_event():
    check_through(through(SPRINGS, 1.03, 1.01), 1.0, inwards=False)


@pytest.mark.nightly
@pytest.mark.parametrize("phase", [0.0, 2.0, -1.0])
@pytest.mark.parametrize("k", [5.0, -0.5])
def test_from_both_sides_wherever_the_period_begins(phase, k):
    """Contact and release both come to no speed there: which acts is not left to rounding."""
    system = SPRINGS.changed(phase=phase, k=k)
    out, into = through(system, 1.03, 1.01), through(system, 1.01, 1.03)
    check_through(out, phase, inwards=False)
    check_through(into, phase, inwards=True)
    ends = into.orbits[-1].state.as_dict(), out.orbits[0].state.as_dict()
    assert list(ends[0].values()) == pytest.approx(list(ends[1].values()), abs=1e-8)
