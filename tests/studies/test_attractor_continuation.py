"""Attractors over a parameter: where they begin and end, against continuation."""

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi
from mems_impact.studies.attractor_continuation import _names

ACTUATOR = mi.load_actuator("zhao2004")
DRIVE = mi.Sine(amplitude=0.2, omega=0.5)
FAST = mi.Options(method="dop853")
VALUES = np.linspace(0.15, 0.25, 11)


@pytest.fixture(scope="module")
def both():
    """Basins in which the actuator is off, or walks."""
    return mi.basins(ACTUATOR, DRIVE, y=("v2", [0.0, 0.6]), options=FAST)


@pytest.fixture(scope="module")
def over(both):
    return mi.continue_attractors(both, "amplitude", VALUES, shares=True, options=FAST)


def test_branches_end_where_motions_jump(over):
    branches = over.branches.set_index("attractor")
    assert set(branches.index) == {"off", "period 1"}
    assert branches.loc["off", "amplitude min"] == 0.15
    assert branches.loc["off", ["before", "after"]].tolist() == ["", "period 1"]
    assert branches.loc["period 1", "amplitude max"] == 0.25
    assert branches.loc["period 1", ["before", "after"]].tolist() == ["off", ""]
    assert branches.loc["period 1", "amplitude min"] < 0.2 < branches.loc["off", "amplitude max"]
    # One row a value of each, in order; where both are, the table has both.
    for name, rows in over.table.groupby("attractor"):
        low, high = branches.loc[name, ["amplitude min", "amplitude max"]]
        inside = VALUES[(low - 1e-9 < VALUES) & (high + 1e-9 > VALUES)]
        assert rows["amplitude"].tolist() == inside.tolist()
    assert "period 1" in repr(over)
    assert "branches" in over.summary()


def test_shares_are_of_the_starts(over, both):
    table = over.table.set_index(["attractor", "amplitude"])["share"]
    assert table["off"].iloc[0] == 1.0
    assert table["period 1"].iloc[-1] == 1.0
    here = both.attractors.set_index("attractor")["share"]
    at = over.table[np.isclose(over.table["amplitude"], 0.2)].set_index("attractor")
    assert at["share"].to_dict() == here.to_dict()


def test_two_that_are_seen_first_at_one_value_have_two_names():
    rows = pd.DataFrame({"A": [1.0, 2.0] * 2, "motion": "periodic", "period": 1})
    names = _names(rows, np.array([0, 2, 1, 3]), {0: "low", 1: "high"}, "A")
    assert names == {0: "low", 2: "period 1 at A = 2 a", 1: "high", 3: "period 1 at A = 2 b"}


def test_what_was_unknown_is_named_by_where_it_was_seen():
    off = mi.basins(ACTUATOR, DRIVE, y=("v2", [0.0]), options=FAST)
    found = mi.continue_attractors(off, "amplitude", [0.2, 0.24, 0.25], options=FAST)
    assert found.branches["attractor"].tolist() == ["off", "period 1 at amplitude = 0.24"]
    assert found.branches["after"].tolist() == ["period 1 at amplitude = 0.24", ""]


def test_a_value_that_is_not_allowed_is_in_no_branch(both):
    found = mi.continue_attractors(both, "e", [0.7, 0.8, 1.5], options=FAST)
    failed = found.table[found.table["attractor"] == "failed"]
    assert failed["e"].tolist() == [1.5]
    assert failed["status"].str.startswith("e = 1.5").all()
    assert set(found.table["e"]) == {0.7, 0.8, 1.5}
    assert found.table["status"].eq("ok").sum() == 4
    assert len(found.branches) == 2


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"parameter": "speed"}, "one of amplitude"),
        ({"values": []}, "one or more finite numbers"),
        ({"basins": 3}, r"as mems_impact\.basins returns"),
        ({"recurrence": 3}, "a RecurrenceOptions"),
    ],
)
def test_what_is_wrong_is_named(both, given, named):
    with pytest.raises(mi.InvalidParameter, match=named):
        mi.continue_attractors(**{"basins": both, "parameter": "e", "values": [0.8], **given})
