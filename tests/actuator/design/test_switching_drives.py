"""Orbits under drives that switch: events pass each other and the switches."""

import numpy as np
import pytest

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004")
CORNER = 0.205259185


@pytest.fixture(scope="module")
def branch():
    drive = mi.Square(amplitude=0.22, omega=0.5, duty=0.3)
    orbit = mi.find_orbit(ZHAO, drive.replace(amplitude=0.3), transient=300)
    return mi.continue_solution(orbit, "amplitude", stop=0.19)


@pytest.mark.nightly
def test_a_branch_continues_where_events_pass_each_other(branch):
    """The end of the slip passes a switch, and nothing happens; the impact does, and it turns."""
    assert [s.label for s in branch.special_points] == ["simultaneous events", "G"]
    assert branch.special_points[0].value == pytest.approx(CORNER, abs=1e-8)
    assert branch.ended == "amplitude reached its bound"
    impacting = branch.table[branch.table["impacts"] == 1]
    assert impacting["amplitude"].min() > CORNER - 1e-9
    assert impacting["admissible"].all()
    turn = int(impacting["amplitude"].argmin())
    assert impacting["stable"].iloc[:turn].all()
    assert not impacting["stable"].iloc[turn + 1 :].any()
    silent = branch.table[branch.table["impacts"] == 0]
    assert silent["admissible"].all()


@pytest.mark.nightly
def test_brute_force_loses_the_orbit_there():
    drive = mi.Square(amplitude=0.3, omega=0.5, duty=0.3)
    values = [*np.linspace(0.3, 0.206, 20), CORNER + 1e-5, CORNER - 1e-5]
    sweep = mi.sweep(
        ZHAO, drive, "amplitude", values[::-1], direction="down", transient=400, periods=10
    )
    impacts = sweep.statistics.set_index("amplitude")["impacts per period"]
    assert impacts.loc[CORNER + 1e-5] == 1.0
    assert impacts.loc[CORNER - 1e-5] == 0.0
