"""Results of studies in files, and through pickle."""

import copy
import pickle

import numpy as np
import pytest
from scipy import stats

import mems_impact as mi

BRIEF = mi.RecurrenceOptions(transient=30, periods=5)
FAST = mi.Options(method="dop853")


def device():
    return mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)


def study_of(kind):
    given = {"recurrence": BRIEF, "options": FAST}
    if kind == "map":
        return mi.operating_map(*device(), x=("amplitude", [0.2, 0.24]), y=("e", [0.8]), **given)
    if kind == "sweep":
        return mi.sweep(*device(), "amplitude", [0.2, 0.24], transient=20, periods=5, options=FAST)
    if kind == "basins":
        return mi.basins(*device(), x=("x2", [0.0, 0.2]), y=("v2", [0.0, 0.6]), **given)
    return mi.tolerance_analysis(*device(), over={"e": stats.norm(0.8, 0.01)}, samples=2, **given)


@pytest.mark.parametrize("kind", ["map", "sweep", "basins", "tolerances"])
def test_a_result_comes_back_as_it_was(kind, tmp_path):
    found = study_of(kind)
    found.save(tmp_path / "found.zip")
    again = mi.load(tmp_path / "found.zip")
    assert again == found
    assert again.table.attrs == found.table.attrs
    assert repr(again) == repr(found)
    for other in (pickle.loads(pickle.dumps(found)), copy.deepcopy(found)):
        assert other == found
    if kind == "map":
        assert np.array_equal(again.grid("period"), found.grid("period"))
