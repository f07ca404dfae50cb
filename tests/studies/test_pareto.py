"""Fronts of two aims, one of them in closed form."""

import math

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi
from tests.analysis.oscillators import thermostat

HEATER = mi.Observable(
    "heater", lambda mode, t, before, after, p: p.q**2, at=("cold",), reduce="max"
)
OVER = {"q": (2.5, 6.0)}
AIMS = {"period": "minimize", "heater": "minimize"}


@pytest.fixture(scope="module")
def orbit():
    return mi.find_orbit(thermostat(observables=(HEATER,)))


@pytest.fixture(scope="module")
def front(orbit):
    return mi.pareto_front(orbit, AIMS, over=OVER, points=5)


@pytest.mark.slow
def test_a_front_in_closed_form(front):
    table = front.table
    # A hotter heater is quicker, and nothing else is varied: the front is the curve of all q.
    q = table["q"].to_numpy()
    np.testing.assert_allclose(table["heater"], q**2, rtol=1e-9)
    np.testing.assert_allclose(table["period"], np.log(2.0 * (q - 1.0) / (q - 2.0)), rtol=1e-8)
    np.testing.assert_allclose(table["heater"], np.linspace(6.25, 36.0, 5), rtol=1e-6)
    assert table["held by"].iloc[0] == "q at its lowest value"
    assert table["held by"].iloc[1] == "heater at most 13.6875"
    assert front.failed == ()


@pytest.mark.nightly
def test_interrupted(orbit):
    def stop(points):
        if points == 3:
            raise KeyboardInterrupt

    with pytest.raises(mi.Interrupted) as error:
        mi.pareto_front(orbit, AIMS, over=OVER, points=5, progress=stop)
    assert len(error.value.partial.table) == 3


def test_a_picture(front, tmp_path):
    ax = mi.plot_pareto(front)
    line, start = ax.lines
    np.testing.assert_allclose(line.get_xdata(), front.table["heater"])
    assert start.get_xdata()[0] == 9.0
    assert start.get_ydata()[0] == pytest.approx(math.log(4.0))
    assert ax.get_xlabel() == "heater\nless is better"
    ax.figure.savefig(tmp_path / "pareto.png")
    assert len(mi.plot_pareto(front.table).lines) == 1
    with pytest.raises(mi.InvalidParameter, match="pareto_front"):
        mi.plot_pareto(pd.DataFrame({"period": [1.0]}))


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"aims": {"period": "minimize"}}, "two quantities"),
        ({"aims": {"period": "up", "heater": "minimize"}}, "two quantities"),
        ({"points": 1}, "points"),
        ({"subject_to": {"heater": (None, 9.0)}}, "subject_to"),
    ],
)
def test_bad_input(orbit, arguments, named):
    with pytest.raises(mi.InvalidParameter, match=named):
        mi.pareto_front(orbit, **{"aims": AIMS, "over": OVER, **arguments})
