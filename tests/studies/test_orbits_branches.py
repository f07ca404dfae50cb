"""Branches, switches, curves and charts as users get them."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.studies.chart import crisis

ZHAO = mi.load_actuator("zhao2004")


def orbit_at(amplitude, omega):
    drive = mi.Sine(amplitude=amplitude, omega=omega)
    return mi.find_orbit(ZHAO, drive, guess=mi.kicked(ZHAO), transient=300)


@pytest.fixture(scope="module")
def branch():
    return mi.continue_orbit(orbit_at(0.24, 0.5), "amplitude", stop=0.16)


@pytest.fixture(scope="module")
def doubling():
    return mi.continue_orbit(orbit_at(0.177, 0.485), "amplitude", stop=0.17)


def test_special_points_of_fig_4(branch):
    assert [s.label for s in branch.special_points] == ["CF", "G"]
    values = [s.value for s in branch.special_points]
    assert values == pytest.approx([0.176515440628, 0.2271775831], abs=1e-10)
    assert list(branch.special_table["label"]) == ["CF", "G"]
    assert branch.special_points[0].multipliers[0] == pytest.approx(1.0, abs=1e-5)


def _cosine(t, q):
    return q[0] * math.cos(0.5 * t)


def _its_rate(t, q):
    return -0.5 * q[0] * math.sin(0.5 * t)


@pytest.mark.slow
@pytest.mark.parametrize("parameter", ["height", "right.amplitude"])
def test_numbers_of_any_drive_are_continued(parameter):
    drives = {
        "height": mi.Custom(
            function=_cosine, rate=_its_rate, period=2.0 * math.pi, values={"height": 0.24}
        ),
        "right.amplitude": mi.TwoSided(
            right=mi.Sine(amplitude=0.24, omega=0.5), left=mi.Sine(amplitude=1e-9, omega=0.5)
        ),
    }
    orbit = mi.find_orbit(ZHAO, drives[parameter], guess=mi.kicked(ZHAO), transient=300)
    branch = mi.continue_orbit(orbit, parameter, stop=0.16)
    assert [s.label for s in branch.special_points] == ["CF", "G"]
    values = [s.value for s in branch.special_points]
    assert values == pytest.approx([0.176515440628, 0.2271775831], abs=1e-8)
    assert parameter in branch.table


def test_table(branch):
    table = branch.table
    assert len(table) == len(branch) == len(branch.orbits)
    assert list(table.columns) == [
        "amplitude", "stable", "admissible", "piece", "largest multiplier", "impacts",
        "impact speed", "step", "closest approach", "v2",
    ]  # fmt: skip
    assert table["amplitude"].iloc[[0, -1]].tolist() == pytest.approx([0.24, 0.16])
    assert branch.ended == "amplitude reached its bound"
    assert set(table["impacts"]) == {0, 1}
    assert table["admissible"].all()
    one = table[(table["impacts"] == 1) & table["stable"]]
    assert one["amplitude"].min() == pytest.approx(0.1765, abs=1e-3)


def test_v2_is_what_brute_force_shows(branch):
    row = branch.table.iloc[-1]
    run = mi.simulate(ZHAO, mi.Sine(amplitude=row["amplitude"], omega=0.5), 400)
    assert run.section(1)["v2"].iloc[-1] == pytest.approx(row["v2"], abs=1e-7)


def test_an_orbit_of_the_branch_knows_its_parameters(branch):
    orbit = branch.orbits[-1]
    assert orbit.drive.amplitude == pytest.approx(0.16)
    assert orbit.drive.omega == 0.5
    assert orbit.actuator == ZHAO


def test_past_grazing_orbits_are_inadmissible():
    orbit = orbit_at(0.16, 0.45)
    branch = mi.continue_orbit(orbit, "amplitude", 0.2, back=0.15, through_grazing=False)
    assert branch.table["admissible"].all()
    orbit = mi.find_orbit(ZHAO, mi.Sine(amplitude=0.22, omega=0.5))
    past = mi.continue_orbit(orbit, "amplitude", 0.24, through_grazing=False)
    last = past.orbits[-1]
    assert not last.admissible
    assert "right impact" in last.defects[0]
    assert last.closest_approach < 0.0
    assert last.samples(100)["x2"].max() > ZHAO.delta


def test_both_sides_of_a_grazing_give_its_type(branch, doubling):
    assert mi.grazing_type(branch.special_points[1]) == "jump"
    grazing = next(s for s in doubling.special_points if s.label == "G")
    assert mi.grazing_type(grazing).paper == "II"
    off = mi.continue_orbit(
        mi.find_orbit(ZHAO, mi.Sine(amplitude=0.2, omega=0.45)), "amplitude", 0.24
    )
    fold, grazing = off.special_points[:2]
    assert fold.value == pytest.approx(0.235565433578, abs=1e-10)
    assert mi.grazing_type(grazing) == mi.GrazingType.DIED_EARLIER
    with pytest.raises(mi.InvalidParameter, match="a grazing"):
        mi.grazing_type(fold)


def test_switching_to_twice_the_period(doubling):
    special = doubling.special_points[0]
    assert special.label == "PD"
    assert special.value == pytest.approx(0.176318773, abs=1e-8)
    two = doubling.switch(special, bounds=(0.1762, 0.1764))
    assert two.orbits[0].periods == 2
    assert "v2 2" in two.table
    spread = (two.table["v2"] - two.table["v2 2"]).abs()
    assert spread.iloc[0] < spread.iloc[-1]
    with pytest.raises(mi.InvalidParameter, match="period doubling"):
        mi.switch_branch(doubling.special_points[1])
    with pytest.raises(mi.InvalidParameter, match="between them"):
        mi.switch_branch(special, bounds=(0.2, 0.3))


def test_a_parameter_of_the_device_up_to_the_end_of_its_range(branch):
    orbit = branch.orbits[0]
    more = mi.continue_orbit(orbit, "c", 0.0, steps=mi.Steps(most=60))
    assert more.table["c"].iloc[0] == ZHAO.c
    assert more.ended


def test_a_curve_and_its_points_of_codimension_two(branch):
    seen = []
    grazing = branch.special_points[1]
    curve = mi.continue_curve(grazing, "omega", 0.478, progress=seen.append)
    assert curve.parameters == ("amplitude", "omega")
    found = {s.kind: s.values for s in curve.special_points}
    assert found["grazing-fold"]["omega"] == pytest.approx(0.480271127, abs=1e-8)
    assert found["degenerate grazing"]["amplitude"] == pytest.approx(0.1710667, abs=1e-6)
    assert list(curve.table.columns[:2]) == ["omega", "amplitude"]
    assert curve.table["omega"].iloc[-1] == pytest.approx(0.478, abs=1e-9)
    assert set(curve.special_table["kind"]) >= {"grazing-fold", "degenerate grazing"}
    assert len(seen) > 3


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("amp", 0.1), "amplitude, omega"),
        (("amplitude", 0.24), "another value"),
        (("amplitude", math.nan), "stop"),
        (("amplitude", -1.0), "amplitude = -1"),
        (("e", 2.0), "e = 2"),
        (("bias", 0.1), "bias"),
    ],
)
def test_wrong_arguments_of_a_branch(branch, arguments, named):
    with pytest.raises(mi.InvalidParameter, match=named):
        mi.continue_orbit(branch.orbits[0], *arguments)


def test_more_wrong_arguments(branch):
    with pytest.raises(mi.InvalidParameter, match="back"):
        mi.continue_orbit(branch.orbits[0], "amplitude", 0.1, back=0.2)
    with pytest.raises(mi.InvalidParameter, match="an Orbit"):
        mi.continue_orbit(branch, "amplitude", 0.1)
    with pytest.raises(mi.InvalidParameter, match="another one"):
        mi.continue_curve(branch.special_points[0], "amplitude", 0.2)
    with pytest.raises(mi.InvalidParameter, match="omega"):
        mi.operating_chart(ZHAO, omega=(0.5, 0.4))


def test_a_branch_that_cannot_go_on_says_so(branch):
    orbit = branch.orbits[0]
    few = mi.continue_orbit(orbit, "amplitude", 0.16, steps=mi.Steps(most=5))
    assert len(few) == 5
    assert "budget" in few.ended
    assert len(few.table) == 5


def test_chart_from_curves_alone():
    chart = mi.operating_chart(ZHAO, omega=(0.478, 0.492), crises=0)
    assert chart.notes == ()
    assert list(chart.types["type"]) == ["III", "II", "I"]
    assert list(chart.types["on"]) == ["fold", "grazing", "grazing"]
    assert list(chart.types["off"]) == ["crisis", "grazing", "fold"]
    borders = chart.types["omega to"].tolist()
    assert borders == pytest.approx([0.480271127, 0.4878087, 0.492], abs=1e-6)
    on = chart.table[chart.table["boundary"] == "on"]
    assert np.all(np.diff(on["omega"]) >= 0.0)
    assert on["omega"].iloc[[0, -1]].tolist() == pytest.approx([0.478, 0.492], abs=1e-8)
    off = chart.table[(chart.table["boundary"] == "off") & (chart.table["type"] == "I")]
    assert (off["amplitude"] <= np.interp(off["omega"], on["omega"], on["amplitude"]) + 1e-4).all()


@pytest.mark.slow
def test_crisis_by_simulation():
    # At omega = 0.5 the attractor ends in the fold, which is known.
    drive = mi.Sine(amplitude=0.2, omega=0.5)
    value = crisis(ZHAO, drive, below=0.177, begin=0.24, tolerance=1e-4, periods=400)
    assert value == pytest.approx(0.17651544, abs=5e-5)
    with pytest.raises(mi.OrbitError, match="begin higher"):
        crisis(ZHAO, drive, below=0.1, periods=300)
