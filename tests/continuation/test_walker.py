"""The simplest walker, whose gaits are limit cycles through heel strikes.

Garcia, Chatterjee, Ruina and Coleman, "The simplest walking model: stability, complexity, and
scaling", Journal of Biomechanical Engineering 120, 281 (1998).
"""

import math

import numpy as np
import pytest

import mems_impact as mi

SWING, LATE = mi.modes("swing", "late")


def flow(mode, t, y, p):
    lean = y.th - p.slope
    turn = math.sin(lean)
    return y.w, turn, y.u, turn + (y.w * y.w - math.cos(lean)) * math.sin(y.ph)


def behind(mode, t, y, p):
    """Positive until the stance leg is past the vertical: before, the swing foot may scuff."""
    return y.th + 0.05


def late(mode, t, y, p):
    return LATE, (y.th, y.w, y.ph, y.u)


def heel(mode, t, y, p):
    return 2.0 * y.th - y.ph


def strike(mode, t, y, p):
    c = math.cos(2.0 * y.th)
    return SWING, (-y.th, c * y.w, -2.0 * y.th, c * (1.0 - c) * y.w)


@pytest.mark.nightly
def test_gaits_double_their_period():
    walker = mi.System(
        states=("th", "w", "ph", "u"),
        flow=flow,
        parameters={"slope": 0.009},
        modes=("swing", "late"),
        guards=[
            mi.Guard("passes the vertical", behind, late, modes=(SWING,)),
            mi.Guard("heel strike", heel, strike, modes=(LATE,)),
        ],
        initial=mi.State(th=0.2, w=-0.2, ph=0.4, u=-0.016, mode="swing"),
    )
    gait = mi.find_orbit(walker, transient=30.0)
    strikes = gait.events[gait.events["event"] == "heel strike"]
    # The paper's long-period gait at this slope.
    assert strikes["th"].abs().iloc[0] == pytest.approx(0.200310900544287, abs=1e-10)
    branch = mi.continue_solution(gait, "slope", 0.016)
    (doubling,) = branch.special_points
    assert doubling.label == "PD"
    assert doubling.value == pytest.approx(0.015088438, abs=1e-9)
    twice = mi.switch_branch(doubling, bounds=(0.014, 0.0185))
    (again,) = twice.special_points
    assert again.label == "PD"
    assert again.value == pytest.approx(0.01766937, abs=1e-8)
    periods = twice.table["period"].to_numpy() / doubling.orbit.period
    assert np.abs(periods - 2.0).max() < 0.1
