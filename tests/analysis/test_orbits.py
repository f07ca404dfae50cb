"""Orbits as users find them: their tables, and what happens where there is none."""

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)


@pytest.fixture(scope="module")
def run():
    return mi.simulate(ZHAO, DRIVE, 300, options=mi.Options(rtol=1e-11, atol=1e-13))


@pytest.fixture(scope="module")
def orbit(run):
    return mi.find_orbit(ZHAO, DRIVE, guess=run.final)


def test_an_orbit_is_where_a_run_ends(run, orbit):
    assert orbit.stable
    assert orbit.admissible
    assert orbit.defects == ()
    assert orbit.residual < 1e-9
    assert orbit.state.x2 == pytest.approx(run.final.x2, abs=1e-9)
    assert orbit.state.v1 == 0.0
    assert orbit.step == pytest.approx(run.statistics["displacement per period"], rel=1e-8)


def test_a_run_along_an_orbit_closes(orbit):
    final = mi.simulate(ZHAO, DRIVE, 1, initial=orbit.state).final
    assert (final.x2, final.v2) == pytest.approx((orbit.state.x2, orbit.state.v2), abs=1e-8)


def test_impacts_are_those_of_the_run(run, orbit):
    skipped = ["period", "t", "x1"]
    mine, theirs = orbit.impacts, run.impacts.tail(2).head(1).reset_index(drop=True)
    assert list(mine.columns) == list(run.impacts.columns)
    pd.testing.assert_frame_equal(
        mine.drop(columns=skipped), theirs.drop(columns=skipped), rtol=1e-7, atol=1e-9
    )


def test_segments(orbit):
    assert list(orbit.segments["mode"]) == ["stuck-free", "forward-free", "stuck-free"]
    assert list(orbit.segments["ends with"]) == ["right impact", "slip end", "period ends"]
    assert orbit.segments["end"].iloc[-1] == orbit.period


def test_section_and_samples_are_those_of_the_run(run, orbit):
    pd.testing.assert_frame_equal(
        orbit.section(1)[["time", "v2"]],
        run.section(1)[["time", "v2"]].tail(1).reset_index(drop=True),
        rtol=1e-7,
    )
    mine, theirs = orbit.samples(50), run.samples(50, first=299)
    assert len(mine) == len(theirs) == 51
    for name in ("time", "x2", "v2"):
        assert mine[name].to_numpy() == pytest.approx(theirs[name].to_numpy(), abs=1e-8)
    moved = theirs["x1"] - theirs["x1"].iloc[0]
    assert mine["x1"].to_numpy() == pytest.approx(moved.to_numpy(), abs=1e-9)
    assert (mine["mode"].astype(str) == theirs["mode"].astype(str)).all()


def test_twice_the_period_is_twice_the_orbit(run, orbit):
    twice = mi.find_orbit(ZHAO, DRIVE, guess=run.final, periods=2)
    assert twice.step == pytest.approx(2 * orbit.step, rel=1e-8)
    assert np.sort(np.abs(twice.multipliers)) == pytest.approx(
        np.sort(np.abs(orbit.multipliers)) ** 2, rel=1e-5
    )
    assert list(twice.impacts["period"]) == [0, 1]
    assert len(twice.samples(10)) == 21


def test_an_orbit_without_impacts():
    orbit = mi.find_orbit(ZHAO, DRIVE.replace(amplitude=0.16))
    assert orbit.impacts.empty
    assert orbit.step == 0.0
    assert 0.0 < orbit.closest_approach < ZHAO.delta
    assert orbit.stable


def test_a_guess_at_another_phase(orbit):
    run = mi.simulate(ZHAO, DRIVE, 300.4)
    found = mi.find_orbit(ZHAO, DRIVE, guess=run.final)
    assert found.state.x2 == pytest.approx(orbit.state.x2, abs=1e-8)


def test_a_branch_over_a_parameter_of_the_scales():
    """Its orbits are in the scales of the first one, and come out as those of their own device."""
    mita, drive = mi.load_actuator("mita2003"), mi.Sine(amplitude=20.0, omega=1000.0)
    branch = mi.continue_solution(mi.find_orbit(mita, drive), "k", 4.6)
    row = branch.table.iloc[4]
    assert abs(row["k"] / mita.k - 1) > 1e-3
    alone = mi.find_orbit(mita.replace(k=row["k"]), drive)
    assert row["v2"] == pytest.approx(alone.section(1)["v2"].iloc[0], rel=1e-8)
    assert row["closest approach"] == pytest.approx(alone.closest_approach, rel=1e-9)
    assert row["largest multiplier"] == pytest.approx(abs(alone.multipliers[0]), rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"guess": mi.State(x2=0.7)}, "stoppers"),
        ({"guess": 3}, "guess = 3: must be a State"),
        ({"periods": 0}, "periods = 0"),
        ({"periods": 1.5}, "whole number"),
        ({"transient": -1}, "transient"),
        ({"transient": np.nan}, "transient"),
    ],
)
def test_wrong_arguments(arguments, named):
    with pytest.raises(mi.InvalidParameter, match=named):
        mi.find_orbit(ZHAO, DRIVE, **arguments)


def test_no_orbit_near_the_guess():
    # Between two impacts of chaos: the signature of one period belongs to no orbit.
    chaos = mi.Sine(amplitude=0.2357, omega=0.45)
    with pytest.raises(mi.OrbitError, match="no orbit") as caught:
        mi.find_orbit(ZHAO, chaos)
    assert isinstance(caught.value.partial, mi.State | None)


OVERDAMPED = ZHAO.replace(c=1e4)


@pytest.mark.filterwarnings("error::mems_impact.StiffnessWarning")
def test_where_the_system_is_stiff_bdf_takes_over_and_says_so(orbit):
    assert orbit.options.method == "dop853"
    drive = mi.Sine(amplitude=0.1, omega=0.5)
    found = mi.find_orbit(OVERDAMPED, drive, guess=mi.State(x2=0.005))
    assert found.options == mi.Options(method="bdf", rtol=1e-11, atol=1e-13)
    # Infinitely damped, the block stays where the mean force and the spring balance.
    x = found.state.x2
    assert x * (1.0 - x) ** 2 == pytest.approx(0.5 * drive.amplitude**2, rel=1e-5)
    # The branch goes on as the orbit does.
    branch = mi.continue_solution(found, "amplitude", 0.11, steps=mi.StepControl(max_points=2))
    assert {each.options.method for each in branch.orbits} == {"bdf"}


@pytest.mark.slow
def test_a_method_that_was_chosen_is_kept_and_says_that_the_system_is_stiff():
    drive, options = mi.Sine(amplitude=0.1, omega=0.5), mi.Options(method="dop853")
    with pytest.warns(mi.StiffnessWarning, match="method 'auto' or 'bdf'"):
        found = mi.find_orbit(OVERDAMPED, drive, guess=mi.State(x2=0.005), options=options)
    assert found.options == options
