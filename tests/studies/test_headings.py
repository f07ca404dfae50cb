"""A column of a study's table holds one quantity, whatever names a system has."""

import math

import pytest
from scipy.stats import uniform

import mems_impact as mi

BRIEF = {"recurrence": mi.RecurrenceOptions(transient=2, periods=1, exponents="none")}
SAME_NAME = "two columns of the table would have this name"


def flow(mode, t, y, p):
    return y[1], p.A * math.cos(math.tau * t / p[1]) - y[0] - 0.4 * y[1]


def system(state="x", duration="T", observable="h"):
    return mi.System(
        states=(state, "v"),
        flow=flow,
        period=lambda p: p[1],
        parameters={"A": 0.4, duration: 6.0},
        observables=[mi.Observable(observable, lambda y, p: y.v)],
    )


PERIOD = system(duration="period")
OVER = {"x": ("A", [0.3, 0.4]), "y": ("T", [6.0])}
BEGUN = {"transient": 2, "periods": 1}
REFUSED = {
    "map": lambda: mi.operating_map(PERIOD, x=("period", [5.0, 6.0]), y=("A", [0.4]), **BRIEF),
    "sweep": lambda: mi.sweep(PERIOD, "period", [5.0, 6.0], **BEGUN),
    "basins": lambda: mi.basins(system(state="returns"), x=("returns", [0.0, 0.1]), **BRIEF),
    "tolerances": lambda: mi.tolerance_analysis(PERIOD, over={"period": "5%"}, samples=2),
    "observable": lambda: mi.operating_map(system(observable="period"), **OVER, **BRIEF),
}


@pytest.mark.parametrize("verb", REFUSED)
def test_a_name_for_two_columns_is_refused(verb):
    with pytest.raises(mi.InvalidParameter, match=f"^(period|returns): {SAME_NAME}"):
        REFUSED[verb]()


def test_an_observable_of_the_name_of_a_varied_parameter_is_refused():
    with pytest.raises(mi.InvalidParameter, match=f"^A: {SAME_NAME}"):
        mi.operating_map(system(observable="A"), **OVER, **BRIEF)


def test_a_parameter_that_differs_from_the_sampled_one_has_another_name():
    options = mi.Options(method="dop853", engine="interpreted")
    given = {"over": {"A": uniform(0.3, 0.1)}, "samples": 2, "options": options, **BRIEF}
    same = mi.tolerance_analysis(system(), parameters=lambda A: {"A": A, "T": 5.0}, **given)
    assert same.table["A"].between(0.3, 0.4).all()
    with pytest.raises(mi.InvalidParameter, match="other values for A than the sampled values"):
        mi.tolerance_analysis(system(), parameters=lambda A: {"A": 2.0 * A}, **given)
