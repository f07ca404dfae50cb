"""Derivatives of orbits' quantities: against differences of other orbits, and closed forms."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.hybrid.differences import weight_of
from tests.analysis.oscillators import thermostat
from tests.analysis.systems import oscillator

ZHAO = mi.load_actuator("zhao2004")
NEAR = mi.State(x2=0.3294504916736363, v2=0.33758229380729476)
DEVICE = ["m1", "m2", "k", "c", "d", "delta", "e", "mu_s", "mu_d", "alpha", "g"]


@pytest.fixture(scope="module")
def orbit():
    return mi.find_orbit(ZHAO, mi.Sine(amplitude=0.24, omega=0.5), guess=NEAR, periods=1)


@pytest.fixture(scope="module")
def found(orbit):
    return mi.sensitivity(orbit)


def quantities_of(orbit):
    step, speeds = orbit.gains["x1"], orbit.impacts["v2 before"].abs()
    return {
        "displacement per period": step,
        "mean speed": step / orbit.period,
        "displacement per impact": step / len(speeds),
        "impact speed": speeds.max(),
        "closest approach": orbit.closest_approach,
        "energy lost per period": orbit.impacts["energy lost"].sum(),
        "largest multiplier": abs(orbit.multipliers[0]),
    }


def by_differences(orbit, name, tell, width=3e-3):
    """Differences of orbits that are found anew, none of whose derivatives are asked for."""
    system, here = orbit.system, orbit.system.parameters[name]
    h = width * (abs(here) or 1.0)
    total = {}
    for s in (-3, -2, -1, 1, 2, 3):
        there = mi.find_orbit(system.changed(**{name: here + s * h}), guess=orbit.state)
        for quantity, value in tell(there).items():
            total[quantity] = total.get(quantity, 0.0) + weight_of(s) / h * value
    return total


@pytest.mark.nightly
def test_by_all_parameters_of_device_and_drive(orbit, found):
    assert set(found.parameters) == {*DEVICE, "amplitude", "omega", "phase"}
    for name in (*DEVICE, "amplitude", "omega"):
        expected = by_differences(orbit, name, quantities_of)
        noise = 1e-11 / (3e-3 * orbit.system.parameters[name])  # orbits are corrected to 1e-11
        for quantity, value in expected.items():
            close = pytest.approx(value, rel=1e-6, abs=noise)
            assert found.gradient(quantity)[name] == close, (quantity, name)


def test_parameters_without_influence(found):
    # The frame breaks away in the impact, and a shift of the voltage in time shifts all.
    for name in ("mu_s", "phase"):
        assert not found.derivatives[:, found.parameters.index(name)].any()


def test_friction_and_weight_act_together(found):
    # Only mu_d g enters an orbit on which the frame at rest is held.
    table = found.table.set_index(["quantity", "parameter"])["elasticity"]
    for quantity in found.quantities:
        assert table[quantity, "mu_d"] == pytest.approx(table[quantity, "g"], rel=1e-6)


def test_energy_that_is_given_by_its_ledger(orbit):
    name = "energy given per period"
    by_ledger = mi.sensitivity(orbit, ["amplitude", "mu_d"], [name]).gradient(name)
    for parameter, value in by_ledger.items():
        expected = by_differences(orbit, parameter, lambda other: {name: mi.energy(other).input})
        noise = 1e-11 / (3e-3 * orbit.system.parameters[parameter])  # as above
        assert value == pytest.approx(expected[name], rel=1e-6, abs=noise)


def test_a_device_in_si_has_the_same_elasticities(found):
    scales = mi.load_actuator("mita2003").scales
    actuator = ZHAO.to_si(scales)
    drive = mi.Sine(amplitude=float(scales.out(0.24, "V")), omega=float(scales.out(0.5, "rad/s")))
    guess = mi.State(x2=float(scales.out(NEAR.x2, "m")), v2=float(scales.out(NEAR.v2, "m/s")))
    there = mi.find_orbit(actuator, drive, guess=guess, periods=1)
    names = ("omega", "k", "d", "g")
    measured = mi.sensitivity(there, names)
    keys = ["quantity", "parameter"]
    one, other = (each.table.set_index(keys)["elasticity"] for each in (found, measured))
    np.testing.assert_allclose(other, one[other.index], rtol=1e-6, atol=1e-8)
    assert set(measured.table["unit"]) == {"m", "m/s", "J", ""}


def test_thermostat_in_closed_form():
    orbit = mi.find_orbit(thermostat())
    found = mi.sensitivity(orbit, quantities=["period"]).gradient("period")
    q, high, low = 3.0, 2.0, 1.0
    assert orbit.period == pytest.approx(math.log((q - low) / (q - high)) + math.log(high / low))
    assert found["q"] == pytest.approx(1.0 / (q - low) - 1.0 / (q - high), rel=1e-8)
    assert found["high"] == pytest.approx(1.0 / (q - high) + 1.0 / high, rel=1e-8)
    assert found["low"] == pytest.approx(-1.0 / (q - low) - 1.0 / low, rel=1e-8)


@pytest.mark.slow
def test_impact_oscillator():
    orbit = mi.find_orbit(oscillator(), transient=100)
    found = mi.sensitivity(orbit)
    assert found.quantities == (
        "speed", "energy", "impact speed", "closest approach", "largest multiplier"
    )  # fmt: skip

    def tell(other):
        return {
            "speed": other.impacts["v before"].max(),
            "energy": 0.0,
            "largest multiplier": abs(other.multipliers[0]),
        }

    for name in found.parameters:
        for quantity, value in by_differences(orbit, name, tell, width=5e-4).items():
            close = pytest.approx(value, rel=1e-6, abs=1e-8)
            assert found.gradient(quantity)[name] == close, (quantity, name)
    pairs = (found.gradient(name) for name in ("speed", "impact speed"))
    np.testing.assert_allclose(*pairs, rtol=1e-8)


@pytest.mark.nightly
def test_switching_times_that_move():
    drive = mi.Trapezoid(amplitude=0.22, omega=0.5, flat=0.4)
    orbit = mi.find_orbit(ZHAO, drive, transient=300)
    names = ["flat", "omega", "amplitude", "delta"]
    found = mi.sensitivity(orbit, names)
    for name in names:
        for quantity, value in by_differences(orbit, name, quantities_of, width=5e-4).items():
            close = pytest.approx(value, rel=1e-5, abs=1e-8)
            assert found.gradient(quantity)[name] == close, (quantity, name)


def test_standard_deviations_to_first_order(found):
    tolerances = {"delta": 0.01, "mu_d": 0.02}
    table = found.standard_deviations(tolerances).set_index("quantity")
    gradient = found.gradient("mean speed")
    parts = [(gradient[name] * sigma) ** 2 for name, sigma in tolerances.items()]
    assert table.loc["mean speed", "standard deviation"] == pytest.approx(math.sqrt(sum(parts)))
    assert table.loc["mean speed", "share delta"] == pytest.approx(parts[0] / sum(parts))


def test_own_quantity(orbit):
    later = mi.Quantity("phase of the impact", lambda each: each.impacts["phase"].iloc[0])
    found = mi.sensitivity(orbit, ["phase", "alpha"], [later]).gradient(later.name)
    # A voltage that is ahead by an angle brings all forward by it; the forcing period is pi/omega.
    assert found["phase"] == pytest.approx(-1.0 / math.pi, rel=1e-8)


@pytest.mark.nightly
def test_at_a_fold_there_is_none(orbit):
    branch = mi.continue_solution(orbit, "amplitude", 0.17)
    fold = next(point for point in branch.special_points if point.label == "CF")
    with pytest.raises(mi.OrbitError, match="fold"):
        mi.sensitivity(fold.orbit, ["k"])


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"over": ["stiffness"]}, "stiffness"),
        ({"over": []}, "over"),
        ({"over": ["k", "k"]}, "different"),
        ({"over": ["bias"]}, "bias"),
        ({"quantities": ["speed"]}, "mean speed"),
        ({"quantities": []}, "quantities"),
    ],
)
def test_bad_input(orbit, arguments, named):
    with pytest.raises(mi.InvalidParameter, match=named):
        mi.sensitivity(orbit, **arguments)


def test_tolerances_as_parts_of_values(found):
    at = found.system.parameters
    relative = found.standard_deviations({"delta": "2%", "mu_d": 0.02})
    absolute = found.standard_deviations({"delta": 0.02 * at["delta"], "mu_d": 0.02})
    assert relative.equals(absolute)


def test_bad_tolerances(found):
    with pytest.raises(mi.InvalidParameter, match="stiffness"):
        found.standard_deviations({"stiffness": 1.0})
    with pytest.raises(mi.InvalidParameter, match="-1"):
        found.standard_deviations({"k": -1.0})
    with pytest.raises(mi.InvalidParameter, match="speedy"):
        found.gradient("speedy")


def test_a_value(found, tmp_path):
    found.save(tmp_path / "found.zip")
    assert mi.load(tmp_path / "found.zip") == found
    assert "mean speed" in found.summary()
