"""Where a function of the user's fails, or a run, a study has a row with the reason and goes on."""

import functools
import math

import pytest
from scipy.stats import uniform

import mems_impact as mi

OPTIONS = mi.Options(method="dop853", engine="interpreted")
BRIEF = mi.RecurrenceOptions(transient=40, periods=2, tolerance=1e-4, exponents="none")
HOW = {"recurrence": BRIEF, "options": OPTIONS, "workers": 1}
FAILS = 0.45  # amplitude above which a function fails


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(t) - y.x - 0.4 * y.v


def gap(mode, t, y, p):
    return 0.3 - y.x


def rebound(mode, t, y, p):
    return mode, (0.3, -0.5 * y.v)


def _failing(function):
    """Return a function that raises beyond an amplitude; its last argument holds that."""

    @functools.wraps(function)
    def failing(*arguments):
        if arguments[-1].A > FAILS:
            raise ValueError("no value here")
        return function(*arguments)

    return failing


FAILING = {
    "period": {"period": _failing(lambda p: math.tau)},
    "switches": {"switches": _failing(lambda p: (1.0,))},
    "flow": {"flow": _failing(flow)},
    "margin": {"guards": [mi.Impact("stop", _failing(gap), rebound)]},
    "transition": {"guards": [mi.Impact("stop", gap, _failing(rebound))]},
    "observable": {"observables": [mi.Observable("speed", _failing(lambda y, p: y.v))]},
    "event": {
        "observables": [
            mi.Observable(
                "blow",
                _failing(lambda mode, t, before, after, p: before.v),
                at=("stop",),
                reduce="max",
            )
        ]
    },
}


def oscillator(**changed):
    given = {
        "states": ("x", "v"),
        "flow": flow,
        "period": math.tau,
        "parameters": {"A": 0.4, "other": 1.0},
        "guards": [mi.Impact("stop", gap, rebound)],
        "initial": {"x": 0.0, "v": 0.0},
    }
    return mi.System(**{**given, **changed})


def _check(table):
    """Rows below the amplitude are fine, those above tell what the function raised."""
    failed = (table["A"] > FAILS).to_numpy()
    assert failed.any()
    assert not failed.all()
    assert (table["status"][~failed] == "ok").all()
    assert table["status"][failed].str.contains("no value here").all()


@pytest.mark.slow(all=True)
@pytest.mark.parametrize("which", FAILING)
def test_a_function_that_fails_at_a_point_is_a_row_with_what_it_raised(which):
    system = oscillator(**FAILING[which])
    found = mi.operating_map(system, x=("A", [0.5, 0.4]), y=("other", [1.0]), **HOW)
    _check(found.table)
    assert found.table["motion"].tolist() == ["failed", "periodic"]


@pytest.mark.slow(all=True)
@pytest.mark.parametrize("which", FAILING)
def test_it_is_a_row_of_a_sweep(which):
    system = oscillator(**FAILING[which])
    _check(
        mi.sweep(
            system, "A", [0.4, 0.5], direction="both", transient=2, periods=1, options=OPTIONS
        ).table
    )


@pytest.mark.quick(1)
@pytest.mark.parametrize("which", ["period", "switches", "event"])
def test_it_is_a_row_of_a_tolerance_analysis_and_of_continued_attractors(which):
    system = oscillator(**FAILING[which])
    over = {"A": uniform(0.35, 0.2)}
    _check(mi.tolerance_analysis(system, over=over, samples=8, **HOW).table)
    found = mi.basins(system, x=("x", [0.0, 0.1]), **HOW)
    branches = mi.continue_attractors(found, "A", [0.4, 0.5], shares=True, **HOW)
    _check(branches.table)
    assert branches.table["attractor"].tolist() == ["period 1", "failed"]
    assert branches.branches["attractor"].tolist() == ["period 1"]
    assert branches.table["share"].tolist()[0] == 1.0


@pytest.mark.parametrize(
    "where", [{"x": ("x", [0.0, 0.1])}, {"box": {"x": (0.0, 0.1)}, "samples": 4}]
)
@pytest.mark.parametrize("exponents", ["none", "all"])
def test_basins_of_which_all_points_fail_tell_why(where, exponents):
    few = mi.Options(method="dop853", engine="interpreted", max_steps=3)
    recurrence = mi.RecurrenceOptions(transient=5, periods=2, exponents=exponents)
    found = mi.basins(oscillator(), **where, recurrence=recurrence, options=few, workers=1)
    assert set(found.table["attractor"]) == {"failed"}
    assert found.table["status"].str.contains("max_steps = 3").all()
    assert found.attractors.empty
    assert found.returns.empty
    assert f"{len(found.table)} failed" in repr(found)
    with pytest.raises(mi.InvalidParameter, match="all points failed"):
        mi.continue_attractors(found, "A", [0.4])


def test_attractors_of_which_all_values_fail_tell_why():
    found = mi.basins(oscillator(), x=("x", [0.0]), **HOW)
    few = {**HOW, "options": mi.Options(method="dop853", engine="interpreted", max_steps=3)}
    branches = mi.continue_attractors(found, "A", [0.3, 0.4], shares=True, **few)
    assert branches.table["status"].str.contains("max_steps = 3").all()
    assert branches.table["attractor"].tolist() == ["failed"] * 2
    assert branches.branches.empty
