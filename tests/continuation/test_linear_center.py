"""Chua's circuit with a piecewise linear resistor: a Hopf point of a linear flow.

Its cycles form a continuum at one value of the parameter, up to the one that touches the border of
the linear piece; there the branch of limit cycles begins (focus-center-limit cycle bifurcation).
"""

import pytest
from scipy.optimize import brentq

import mems_impact as mi

MIDDLE, RIGHT = mi.modes("middle", "right")
SLOPES, BETA = (-8.0 / 7.0, -5.0 / 7.0), 100.0 / 7.0


def flow(mode, t, y, p):
    current = SLOPES[0] * y.x if mode == MIDDLE else SLOPES[1] * y.x + SLOPES[0] - SLOPES[1]
    return p.alpha * (y.y - y.x - current), y.x - y.y + y.z, -BETA * y.y


def inside(mode, t, y, p):
    return 1.0 - y.x


def outside(mode, t, y, p):
    return y.x - 1.0


def to_right(mode, t, y, p):
    return RIGHT, (y.x, y.y, y.z)


def to_middle(mode, t, y, p):
    return MIDDLE, (y.x, y.y, y.z)


def hurwitz(alpha):
    """Return zero where the characteristic polynomial of the right piece has imaginary roots."""
    damping = alpha * (1.0 + SLOPES[1])
    return (damping + 1.0) * (BETA + damping - alpha) - damping * BETA


@pytest.mark.nightly
def test_a_continuum_of_cycles_has_no_folds_and_leads_to_limit_cycles():
    chua = mi.System(
        states=("x", "y", "z"),
        flow=flow,
        parameters={"alpha": 6.0},
        guards=[
            mi.Guard("enters", inside, to_right, modes=(MIDDLE,)),
            mi.Guard("leaves", outside, to_middle, modes=(RIGHT,)),
        ],
        initial=mi.State(x=1.5, z=-1.5, mode=RIGHT),
    )
    (rest,) = mi.find_equilibria(chua, modes=["right"])
    (hopf,) = mi.continue_solution(rest, "alpha", 8.0).special_points
    assert hopf.value == pytest.approx(brentq(hurwitz, 6.0, 8.0), abs=1e-9)
    assert hopf.criticality == ""
    cycles = mi.switch_branch(hopf, bounds=(5.0, 8.5))
    touch, doubling = cycles.special_points
    assert touch.kind == "leaves"
    assert touch.value == pytest.approx(hopf.value, abs=1e-8)
    assert doubling.label == "PD"
    assert cycles.ended == "alpha reached its bound"
    assert cycles.table["admissible"].all()
    # The doubling is also that of the attractor.
    cycle = mi.find_orbit(chua.changed(alpha=8.0), guess={"x": 2.13, "y": 0.14, "z": -2.9})
    (same,) = mi.continue_solution(cycle, "alpha", 8.4).special_points
    assert doubling.value == pytest.approx(same.value, abs=1e-8)
