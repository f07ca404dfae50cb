"""Ctrl-C after the last point of a study, while its table is evaluated, loses no point."""

import math

import pytest
from scipy.stats import uniform

import mems_impact as mi
from mems_impact.studies import attractor_continuation, attractor_matching, uncertainty

BRIEF = {
    "recurrence": mi.RecurrenceOptions(transient=40, periods=2, exponents="none"),
    "options": mi.Options(method="dop853", engine="interpreted"),
}


@pytest.fixture(scope="module")
def system():
    return mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, p.A * math.cos(t) - y.x - 0.8 * y.v),
        period=math.tau,
        parameters={"A": 0.4},
    )


def basins(system):
    return mi.basins(system, x=("x", [0.0, 0.1]), **BRIEF)


def shares(system):
    return mi.continue_attractors(basins(system), "A", [0.3, 0.4], shares=True, **BRIEF)


def indices(system):
    over = {"A": uniform(0.3, 0.1)}
    return mi.tolerance_analysis(system, over=over, samples=2, indices=True, **BRIEF)


@pytest.mark.parametrize(
    ("study", "module", "function", "points"),
    [
        (basins, attractor_matching, "match_attractors", 2),
        (basins, attractor_matching, "continued_motions", 2),
        (shares, attractor_continuation, "match_branches", 2),
        (shares, attractor_continuation, "count_in", 2),
        (indices, uncertainty, "indices_table", 6),
    ],
)
def test_the_interruption_holds_the_points(study, module, function, points, system, monkeypatch):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, function, interrupt)
    with pytest.raises(mi.Interrupted) as caught:
        study(system)
    stop = caught.value
    assert stop.after == f"{points} of {points} points"
    assert stop.partial["status"].tolist() == ["ok"] * points
