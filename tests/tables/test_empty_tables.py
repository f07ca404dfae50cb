"""A table without rows has the columns, types and units of one with rows."""

import math

import pytest
from scipy import stats

import mems_impact as mi
from mems_impact.tables import row_table

PLAIN = mi.Options(method="dop853", engine="interpreted")
FAST = mi.Options(method="dop853")
SHORT = mi.RecurrenceOptions(transient=5, periods=2, exponents="none", chaos_persistence=1.0)


def check(empty, full):
    assert len(empty) == 0 < len(full)
    assert empty.dtypes.to_dict() == full.dtypes.to_dict()
    assert list(empty) == list(full)
    assert empty.attrs.get("units") == full.attrs.get("units")


def shaken(mode, t, y, p):
    if p.A > 5.0 and t > 0.5:
        return y.v, math.nan
    return y.v, p.A * math.cos(t) - 0.2 * y.v - y.x


def gap(mode, t, y, p):
    return 1.0 - y.x


def rebound(mode, t, y, p):
    return mode, (1.0, -0.7 * y.v)


def struck():
    return mi.System(
        states=("x", "v"), flow=shaken, period=2.0 * math.pi, parameters={"A": 0.1},
        guards=[mi.Impact("wall", gap, rebound)],
        observables=[mi.Observable("hit", lambda m, t, a, b, p: a.v, at=("wall",), reduce="max")],
        units={"x": "m", "v": "m/s", "time": "s", "A": "N"},
    )  # fmt: skip


@pytest.fixture(scope="module")
def orbit():
    return mi.find_orbit(struck(), transient=30, options=FAST)


@pytest.mark.slow
def test_special_points_of_a_branch(orbit):
    grazing = mi.continue_solution(orbit, "A", 0.25, through_grazing=False)
    check(mi.continue_solution(orbit, "A", 0.11).special_table, grazing.special_table)
    columns = [name for name in grazing.table if name not in ("A", "piece")]
    names = ["label", "A", "kind", "criticality", "type", *columns]
    assert list(grazing.special_table) == names


def fork(mode, t, y, p):
    return (p.a * y.x - y.x**3 + p.b,)


@pytest.mark.slow
def test_special_points_of_equilibria_and_of_a_curve():
    system = mi.System(states=("x",), flow=fork, parameters={"a": 1.0, "b": -1.0})
    (first,) = mi.find_equilibria(system, guess={"x": -1.2})
    through = mi.continue_solution(first, "b", 1.0)
    assert len(through.special_points) == 2
    check(mi.continue_solution(first, "b", -0.9).special_table, through.special_table)
    steps = mi.StepControl(initial_step=0.02, max_step=0.3)
    fold = through.special_points[0]
    cusp = mi.continue_curve(fold, "a", -1.0, back=1.5, steps=steps)
    check(mi.continue_curve(fold, "a", 1.1, steps=steps).special_table, cusp.special_table)


@pytest.mark.slow
def test_a_bifurcation_diagram():
    system = mi.System(states=("x",), flow=fork, parameters={"a": 1.0, "b": 0.0})
    given = {"values": 2, "starts": 1, "recurrence": SHORT, "options": PLAIN}
    full = mi.bifurcation_diagram(system, "a", (-0.5, 0.5), **given)
    bare = mi.bifurcation_diagram(system, "a", (-0.5, -0.4), **given)
    check(bare.special_table, full.special_table)
    assert list(full.special_table)[-1] == "branch"


def test_basins_whose_points_all_failed():
    def basins(system):
        return mi.basins(system, x=("x", [0.0]), recurrence=SHORT, workers=1, options=PLAIN)

    full, none = basins(struck()), basins(struck().changed(A=6.0))
    check(none.attractors, full.attractors)
    check(none.returns, full.returns)


def test_a_study_interrupted_before_its_first_point(monkeypatch):
    def stop(*arguments, **named):
        raise KeyboardInterrupt

    given = {"over": {"A": stats.uniform(0.1, 0.1)}, "samples": 2, "recurrence": SHORT}
    given |= {"options": PLAIN, "workers": 1}
    full = mi.tolerance_analysis(struck(), **given)
    monkeypatch.setattr("mems_impact.studies.attractor_study.map_attractors", stop)
    with pytest.raises(mi.Interrupted) as caught:
        mi.tolerance_analysis(struck(), **given)
    check(caught.value.partial, full.points)


def test_rows_of_a_device():
    system = mi.load_actuator("zhao2004").under(mi.Sine(amplitude=0.24, omega=0.5))
    headings = {"kind": str, "omega": float, "amplitude": float}
    full = row_table(headings, [("fold", 0.5, 0.2)], system)
    check(row_table(headings, [], system), full)
