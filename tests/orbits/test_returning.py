"""How a return is recognised, on sequences that are given."""

from types import SimpleNamespace

import numpy as np
import pytest

from mems_impact.hybrid.trajectory import Instant
from mems_impact.orbits.returning import _section


@pytest.mark.parametrize(
    ("extent", "chosen"),
    [([0.1, 0.5], 0), ([10.0, 0.5], 1), ([0.0, 0.0], 1), ([0.0, 4.0], 0)],
    ids=["both small", "one large", "none yet", "one yet"],
)
def test_the_section_cuts_what_changes_fastest_against_its_extent(extent, chosen):
    """The rates are 1 and 2; a third component, which is cyclic, changes at 100."""

    def flow(mode, t, y, p, dy):
        dy[:] = 1.0, 100.0, 2.0

    problem = SimpleNamespace(parameters=(), automaton=SimpleNamespace(flow=flow))
    start = Instant(0, 0.0, 0, np.array([5.0, 6.0, 7.0]))
    free = [0, 2]
    place = free[chosen]
    assert _section(problem, start, np.array(extent), free) == (place, start.y[place], 0)
