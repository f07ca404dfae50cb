"""Branches, switches, curves and charts as users get them."""

import math
import re

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.design import chart_construction
from mems_impact.actuator.design.thresholds import locate_crisis
from mems_impact.actuator.units import DeviceScales
from mems_impact.analysis.orbit import ORBIT_OPTIONS

ZHAO = mi.load_actuator("zhao2004")


def orbit_at(amplitude, omega):
    drive = mi.Sine(amplitude=amplitude, omega=omega)
    return mi.find_orbit(ZHAO, drive, guess=mi.kicked_state(ZHAO), transient=300)


@pytest.fixture(scope="module")
def branch():
    return mi.continue_solution(orbit_at(0.24, 0.5), "amplitude", stop=0.16)


@pytest.fixture(scope="module")
def doubling():
    return mi.continue_solution(orbit_at(0.177, 0.485), "amplitude", stop=0.17)


@pytest.mark.slow
def test_special_points_of_fig_4(branch):
    assert [s.label for s in branch.special_points] == ["CF", "G"]
    values = [s.value for s in branch.special_points]
    assert values == pytest.approx([0.176515440628, 0.2271775831], abs=1e-10)
    assert list(branch.special_table["label"]) == ["CF", "G"]
    assert branch.special_points[0].orbit.multipliers[0] == pytest.approx(1.0, abs=1e-5)
    # At no impact speed a multiplier has no bound, and what rounding makes of that is no figure.
    assert branch.special_table["largest multiplier"].tolist() == [pytest.approx(1.0), math.inf]


@pytest.mark.nightly
def test_a_fold_with_its_impact_at_the_start_of_a_period(branch):
    fold = branch.special_points[0]
    drive = mi.Sine(amplitude=0.24, omega=0.5, phase=0.5 * fold.orbit.impacts["time"].iloc[0])
    orbit = mi.find_orbit(ZHAO, drive, guess=mi.kicked_state(ZHAO), transient=300)
    shifted = mi.continue_solution(orbit, "amplitude", stop=0.16)
    assert [s.label for s in shifted.special_points] == ["CF", "G"]
    assert shifted.special_points[0].value == pytest.approx(fold.value, abs=1e-9)


def test_an_orbit_at_rest_on_a_stopper():
    """Above the resting voltage of 0.354 the block stays there, and all perturbations vanish."""
    drive = mi.Sine(amplitude=0.05, bias=0.6, omega=0.5)
    orbit = mi.find_orbit(ZHAO, drive, transient=50)
    assert orbit.multipliers.tolist() == [0.0]
    assert orbit.stable
    branch = mi.continue_solution(orbit, "amplitude", stop=0.06)
    assert branch.ended == "amplitude reached its bound"
    assert set(branch.table["largest multiplier"]) == {0.0}


# A device under a square wave, whose orbit with three impacts grazes where one with four joins.
SWITCHED = mi.Actuator(
    m1=24.3283251270096, m2=1.0, k=1.298951881659454, c=0.286575243617524, d=1.0,
    delta=0.2404180119478011, e=0.6162524571957751, mu_s=0.2321270847825908,
    mu_d=0.20453662758979016, alpha=1.0, g=2.1580142533682705,
)  # fmt: skip
SQUARE = mi.Square(amplitude=0.6106797744688056, omega=0.8738705532393327, duty=0.3908614095356825)


@pytest.fixture(scope="module")
def switched():
    orbit = mi.find_orbit(SWITCHED, SQUARE, guess=mi.kicked_state(SWITCHED), transient=300)
    return mi.continue_solution(
        orbit, "delta", 0.144, steps=mi.StepControl(max_step=0.02, max_points=60)
    )


@pytest.mark.nightly
def test_the_orbits_beyond_a_grazing_against_the_walk_are_found(switched):
    grazing = switched.special_points[0]
    assert (grazing.label, grazing.value) == ("G", pytest.approx(0.20026297191, abs=1e-9))
    beyond = switched.table[switched.table["piece"] == 1]
    assert set(beyond["impacts"]) == {4}
    assert beyond["admissible"].all()
    # They lie where the branch came from, not ahead.
    assert (beyond["delta"].iloc[:5] > grazing.value).all()
    orbit = switched.orbits[beyond.index[5]]
    found = mi.find_orbit(orbit.actuator, SQUARE, guess=orbit.state)
    assert len(found.impacts) == 4
    assert found.state.x2 == pytest.approx(orbit.state.x2, abs=1e-9)
    assert found.multipliers[0] == pytest.approx(orbit.multipliers[0], rel=1e-5)


@pytest.mark.nightly
def test_an_impact_that_meets_a_switch_is_a_corner_at_which_a_branch_turns(switched):
    corner = switched.special_points[1]
    assert corner.kind == "simultaneous events"
    assert corner.value == pytest.approx(0.2252675, abs=1e-6)
    assert switched.table["delta"].max() == pytest.approx(SWITCHED.delta)
    after = switched.table[switched.table["piece"] == 1]
    assert after["delta"].max() <= corner.value
    assert after["delta"].iloc[-1] < corner.value
    # The impact, and then the end of its slip, come before the switch.
    ends = switched.orbits[after.index[-2]].segments["ends with"].tolist()
    assert ends == 4 * ["right impact", "slip end"] + 2 * ["drive switches"]


def test_table(branch):
    table = branch.table
    assert len(table) == len(branch) == len(branch.orbits)
    assert list(table.columns) == [
        "amplitude", "stable", "admissible", "piece", "largest multiplier", "impacts",
        "impact speed", "closest approach", "step", "energy lost", "v2",
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
    branch = mi.continue_solution(orbit, "amplitude", 0.2, back=0.15, through_grazing=False)
    assert branch.table["admissible"].all()
    orbit = mi.find_orbit(ZHAO, mi.Sine(amplitude=0.22, omega=0.5))
    past = mi.continue_solution(orbit, "amplitude", 0.24, through_grazing=False)
    last = past.orbits[-1]
    assert not last.admissible
    assert "right impact" in last.defects[0]
    assert last.closest_approach < 0.0
    assert last.samples(100)["x2"].max() > ZHAO.delta


def test_both_sides_of_a_grazing_give_its_type(branch, doubling):
    assert branch.special_points[1].type == "jump"
    grazing = next(s for s in doubling.special_points if s.label == "G")
    assert grazing.type.paper == "II"
    off = mi.continue_solution(
        mi.find_orbit(ZHAO, mi.Sine(amplitude=0.2, omega=0.45)), "amplitude", 0.24
    )
    fold, grazing = off.special_points[:2]
    assert fold.value == pytest.approx(0.235565433578, abs=1e-10)
    assert grazing.type == mi.GrazingType.AFTER_FOLD
    assert fold.type is None


def test_switching_to_twice_the_period(doubling):
    special = doubling.special_points[0]
    assert special.label == "PD"
    assert special.value == pytest.approx(0.176318773, abs=1e-8)
    two = mi.switch_branch(special, bounds=(0.1762, 0.1764))
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
    more = mi.continue_solution(orbit, "c", 0.0, steps=mi.StepControl(max_points=60))
    assert more.table["c"].iloc[0] == ZHAO.c
    assert more.ended


@pytest.mark.slow
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
        mi.continue_solution(branch.orbits[0], *arguments)


def test_more_wrong_arguments(branch):
    with pytest.raises(mi.InvalidParameter, match="back"):
        mi.continue_solution(branch.orbits[0], "amplitude", 0.1, back=0.2)
    with pytest.raises(mi.InvalidParameter, match="an Orbit"):
        mi.continue_solution(branch, "amplitude", 0.1)
    with pytest.raises(mi.InvalidParameter, match="other than the parameter"):
        mi.continue_curve(branch.special_points[0], "amplitude", 0.2)
    with pytest.raises(mi.InvalidParameter, match="omega"):
        mi.operating_chart(ZHAO, omega=(0.5, 0.4))


def test_a_branch_that_ends_early_gives_the_reason(branch):
    orbit = branch.orbits[0]
    few = mi.continue_solution(orbit, "amplitude", 0.16, steps=mi.StepControl(max_points=5))
    assert len(few) == 5
    assert "budget" in few.ended
    assert len(few.table) == 5


@pytest.mark.nightly
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


SCALES = DeviceScales.of_device(2.1e-6, 4.7, 5e-6, 8.9e-20)


@pytest.mark.slow
def test_a_chart_in_si_finds_its_band_and_speaks_its_units():
    device, heard = ZHAO.to_si(SCALES), []
    # The lower end is that of the band: 0.44 in the units of the paper.
    chart = mi.operating_chart(
        device, omega=(None, 0.46 / SCALES.time), crises=0, progress=heard.append
    )
    assert chart.frequencies == pytest.approx((0.44 / SCALES.time, 0.46 / SCALES.time))
    assert list(chart.types["type"]) == ["III"]
    said = [line for line in heard if "type III" in line]
    assert said == [
        f"omega [rad/s] = {chart.frequencies[0]:.9g} to {chart.frequencies[1]:.9g}: type III"
    ]


def test_the_band_of_a_chart_is_about_the_resonance():
    assert default_band(ZHAO) == pytest.approx((0.44, 0.51), abs=1e-15)
    assert default_band(ZHAO.replace(k=4.0)) == pytest.approx((0.88, 1.02))
    # With a bias the force repeats once in a period of the voltage, not twice.
    assert default_band(ZHAO, bias=0.1) == pytest.approx((0.88, 1.02))


def default_band(device, bias=0.0):
    drive = mi.Sine(amplitude=0.0, omega=1.0, bias=bias)
    return chart_construction._band(device.under(drive))


def test_a_chart_without_a_band_says_what_it_found():
    with pytest.raises(
        mi.OrbitError, match=r"at omega \[rad/s\] = 1000 .* does not graze.*; lower"
    ):
        mi.operating_chart(ZHAO.to_si(SCALES), omega=(1000.0, 1100.0), crises=0)


@pytest.mark.nightly
def test_a_chart_without_types_has_the_voltages_at_single_frequencies():
    device = ZHAO.replace(mu_d=1e-6).to_si(SCALES)  # what slips, slips on
    resonance = 1.0 / SCALES.time
    chart = mi.operating_chart(
        device, omega=(0.5 * resonance, 0.505 * resonance), crises=0, columns=1
    )
    where = r"at omega \[rad/s\] = \d+(\.\d+)? and amplitude \[V\] = \d+(\.\d+)?: "
    (note,) = chart.notes
    assert re.match(f"no types: {where}a weak contact does not return", note)
    assert chart.types.empty
    (on,) = chart.table.query("boundary == 'on'")["amplitude"]
    drive = mi.Sine(amplitude=on, omega=0.5 * resonance)
    slowly = np.array([0.5, 0.8, 0.9, 0.95, 0.97, 0.98, 0.99, 0.995, 1.005])  # without overshoot
    raised = mi.sweep(device, drive, "amplitude", slowly * on, direction="up", periods=20)
    assert raised.statistics["impacting"].tolist() == [False] * 8 + [True]


def test_a_stopper_before_pull_in_bounds_the_search():
    device = ZHAO.replace(delta=0.2)
    maker = chart_construction.ChartBuilder(
        device.under(mi.Sine(amplitude=0.0, omega=1.0)),
        ORBIT_OPTIONS,
        mi.StepControl(),
        print,
        (0.44, 0.51),
    )
    assert maker.pull_in == pytest.approx(mi.resting_voltage(device))
    assert maker.pull_in < math.sqrt(4.0 / 27.0)


def test_a_weak_contact_after_which_the_frame_slides_on_is_named():
    """With hardly any friction the slip of a trial impact does not end."""
    device = ZHAO.replace(mu_d=1e-6)
    orbit = mi.find_orbit(device, mi.Sine(amplitude=0.2, omega=0.5))
    found = mi.continue_solution(orbit, "amplitude", 0.24, through_grazing=False)
    with pytest.raises(mi.OrbitError, match="does not return"):
        _ = found.special_points[0].type


@pytest.mark.nightly
def test_crisis_by_simulation():
    # At omega = 0.5 the attractor ends in the fold, which is known.
    drive = mi.Sine(amplitude=0.2, omega=0.5)
    value = locate_crisis(ZHAO, drive, amplitude=0.177, begin=0.24, tolerance=1e-4, periods=400)
    assert value == pytest.approx(0.17651544, abs=5e-5)
    with pytest.raises(mi.OrbitError, match="begin higher"):
        locate_crisis(ZHAO, drive, amplitude=0.1, periods=300)


def test_a_motion_without_impacts_beside_the_attractor_with_impacts_is_named():
    """Between fold and on-boundary both motions exist; from rest the block does not strike."""
    drive = mi.Sine(amplitude=0.2, omega=0.5)
    assert mi.find_orbit(ZHAO, drive, guess=mi.kicked_state(ZHAO)).stable
    with pytest.raises(mi.OrbitError, match="the motion from the initial state ends without"):
        locate_crisis(ZHAO, drive, amplitude=0.2, start=mi.State(), periods=100)


@pytest.mark.slow
def test_a_large_parameter_takes_few_steps():
    stop = mi.Stopper("wall", "x", "v", upper=0.4, law=lambda depth, rate, p: p.k * depth)
    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, 0.8 * math.cos(t) - 0.2 * y.v - y.x),
        parameters={"k": 400.0},
        period=2.0 * math.pi,
        parts=[stop],
    )
    branch = mi.continue_solution(mi.find_orbit(system, transient=100), "k", stop=200.0)
    assert branch.ended == "k reached its bound"
    assert len(branch.orbits) < 100
