"""Basin entropy and uncertainty exponent, against closed forms and published numbers."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.studies.basin_entropy import basin_entropy, uncertainty_exponent

TURN = 2.0 * math.pi


def test_entropy_of_boxes_in_closed_form():
    """Four boxes: one attractor, two halves, a quarter against three, three attractors."""
    grid = np.full((4, 4), "a", dtype=object)
    grid[0, 2:], grid[2, 0], grid[2:, 2], grid[3, 3] = "b", "b", "b", "c"
    quarter = -0.25 * math.log(0.25) - 0.75 * math.log(0.75)
    boxes = [math.log(2.0), quarter, -0.5 * math.log(0.5) - 0.5 * math.log(0.25)]
    found = basin_entropy(grid, 2)
    assert found.basin == pytest.approx(sum(boxes) / 4.0, rel=1e-14)
    assert found.boundary == pytest.approx(sum(boxes) / 3.0, rel=1e-14)
    assert (found.boxes, found.boundary_boxes) == (4, 3)
    # Failed points have no part in a box, and a box of failed points does not count.
    grid[:2, :2], grid[2, 0] = "failed", "failed"
    found = basin_entropy(grid, 2)
    assert (found.boxes, found.boundary_boxes) == (3, 2)
    assert found.basin == pytest.approx((boxes[0] + boxes[2]) / 3.0, rel=1e-14)


def test_a_straight_boundary_has_exponent_one_and_one_basin_none():
    grid = np.add.outer(np.arange(40), 0 * np.arange(50)) < 17
    assert uncertainty_exponent(grid, None).exponent == pytest.approx(1.0, abs=1e-12)
    assert math.isnan(uncertainty_exponent(np.zeros((20, 20)), None).exponent)
    assert math.isnan(basin_entropy(np.zeros((20, 20)), 5).boundary)


def test_the_cantor_set_has_the_exponent_of_its_dimension():
    """Attractors alternate from one to the next gap of the Cantor set: 1 - log 2 / log 3."""
    gaps = np.zeros(3**12, dtype=int)
    for level in range(12):
        width = 3 ** (11 - level)
        middle = np.arange(3**12) // width % 3 == 1
        gaps[(gaps == 0) & middle] = 1 + level % 2
    found, expected = uncertainty_exponent(gaps, 3**8), 1.0 - math.log(2.0) / math.log(3.0)
    assert found.exponent == pytest.approx(expected, abs=2.0 * found.error)
    assert found.error < 0.005


def test_arguments_of_the_entropy():
    grid = np.zeros((12, 8))
    with pytest.raises(mi.InvalidParameter, match="at most 8"):
        basin_entropy(grid, 9)
    with pytest.raises(mi.InvalidParameter, match="8 points: give at least 10"):
        uncertainty_exponent(grid, None)
    with pytest.raises(mi.InvalidParameter, match="below 6, half"):
        uncertainty_exponent(np.zeros((12, 12)), 6)


def _still(mode, t, y, p):
    return 0.0, 0.0


def _grebogi(mode, t, y, p):
    angle = y.angle + 1.32 * math.sin(2.0 * y.angle) - 0.9 * math.sin(4.0 * y.angle)
    angle -= y.x * math.sin(y.angle)
    # The attractors at the angles 0 and pi lie inside the interval.
    return mode, ((angle + 0.5 * math.pi) % TURN - 0.5 * math.pi, -0.3 * math.cos(y.angle))


GREBOGI = mi.System(
    states=("angle", "x"), flow=_still, switch_transition=_grebogi, switches=(0.5,), period=1.0
)
RESTING = {
    "recurrence": mi.RecurrenceOptions(transient=200, periods=1, longest=2, exponents="none"),
    "options": mi.Options(method="dop853", rtol=1e-6, atol=1e-8),
}


@pytest.mark.nightly
def test_entropies_of_the_grebogi_map():
    """Map and exponent, about 0.2, of Grebogi et al. (1983); entropies in Attractors.jl's tests."""
    # The other half of 300 angles is its mirror image, box by box.
    angles = np.linspace(0.0, TURN, 300)[:150]
    found = mi.basins(GREBOGI, x=("angle", angles), y=("x", np.linspace(-0.5, 0.5, 300)), **RESTING)
    assert len(found.attractors) == 2
    entropy = found.entropy(6)
    assert 0.40 <= entropy.basin <= 0.42
    assert 0.60 <= entropy.boundary <= 0.61
    line = mi.basins(
        GREBOGI, x=("angle", np.linspace(0.0, TURN, 20_000)), initial={"x": 0.1}, **RESTING
    )
    exponent = line.uncertainty_exponent(400)
    assert exponent.exponent == pytest.approx(0.2, abs=exponent.error)
    assert exponent.error < 0.06
