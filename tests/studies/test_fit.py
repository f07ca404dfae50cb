"""Fits find parameters that are known, and say what the data leave open."""

import math

import numpy as np
import pytest

import mems_impact as mi

DEVICE = mi.load_actuator("mita2003")
SLOW = mi.Sine(amplitude=100.0, omega=2 * math.pi)
FASTER = mi.Sine(amplitude=60.0, omega=2 * math.pi)


def measured(device, drive):
    return mi.blows(mi.simulate(device, drive, 4, window=(2, 4))).displacement_per_blow


def test_two_parameters_are_found_again():
    targets = [
        mi.Target(quantity="displacement per impact", value=measured(DEVICE, SLOW), drive=SLOW),
        mi.Target(quantity="pull-in voltage", value=mi.pull_in_voltage(DEVICE), tolerance=0.5),
    ]
    start = DEVICE.replace(k=1.3 * DEVICE.k, alpha=0.8 * DEVICE.alpha)
    found = mi.fit(start, targets, free=["k", "alpha"])
    assert found.converged
    assert math.isclose(found.actuator.k, DEVICE.k, rel_tol=1e-5)
    assert math.isclose(found.actuator.alpha, DEVICE.alpha, rel_tol=1e-5)
    assert found.actuator.replace(k=start.k, alpha=start.alpha) == start
    assert np.abs(found.residuals["in tolerances"]).max() < 1e-3
    assert found.residuals["quantity"].tolist()[1] == "pull-in voltage [V]"
    assert found.parameters["parameter"].tolist() == ["k [N/m]", "alpha [F m]"]
    assert found.note == "the data determine all free parameters"
    assert (found.singular_values > 1).all()


def test_one_number_cannot_tell_two_parameters_apart():
    target = mi.Target(quantity="displacement per impact", value=21e-9, drive=SLOW)
    found = mi.fit(DEVICE, [target], free=["k", "alpha"])
    assert abs(found.residuals["in tolerances"][0]) < 1e-3
    assert "cannot tell" in found.note
    assert "alpha, k apart" in found.note
    assert np.isinf(found.parameters["standard error"]).all()
    # Along the combination that the note names nothing changes, indeed.
    power = float(found.note.split("k^")[1].split()[0])
    moved = found.actuator.replace(
        k=found.actuator.k * 1.02**power, alpha=found.actuator.alpha * 1.02
    )
    assert math.isclose(measured(moved, SLOW), 21e-9, rel_tol=1e-3)


def test_a_parameter_that_no_target_feels():
    target = mi.Target(quantity="pull-in voltage", value=30.0)
    found = mi.fit(DEVICE, [target], free=["k", "mu_s"])
    assert "the data do not determine mu_s" in found.note
    assert found.actuator.mu_s == DEVICE.mu_s
    assert math.isclose(mi.pull_in_voltage(found.actuator), 30.0, rel_tol=1e-6)


def test_a_bound_holds_and_is_reported():
    target = mi.Target(quantity="pull-in voltage", value=300.0)
    found = mi.fit(DEVICE, [target], free=["k"], bounds={"k": (1.0, 10.0)})
    assert found.actuator.k <= 10.0
    assert math.isclose(found.actuator.k, 10.0, rel_tol=1e-6)
    assert found.residuals["difference"][0] < -200.0
    assert "k stands at its upper bound" in found.note


def test_a_count_cannot_be_fitted_and_the_note_says_so():
    targets = [
        mi.Target(quantity="displacement per impact", value=20e-9, drive=SLOW),
        mi.Target(quantity="impacts per period", value=1.0, drive=SLOW),
    ]
    found = mi.fit(DEVICE, targets, free=["k"])
    assert "impacts per period reacts to none" in found.note
    assert found.residuals["computed"][1] == 1.0


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"quantity": "colour", "value": 1.0}, "quantity"),
        ({"quantity": "pull-in voltage", "value": math.nan}, "value"),
        ({"quantity": "pull-in voltage", "value": 1.0, "drive": SLOW}, "drive"),
        ({"quantity": "mean speed", "value": 1.0}, "drive"),
        ({"quantity": "pull-in voltage", "value": 1.0, "tolerance": 0.0}, "tolerance"),
        ({"quantity": "pull-in voltage", "value": 0.0}, "tolerance"),
    ],
)
def test_wrong_targets(values, text):
    with pytest.raises(mi.InvalidParameter, match=text):
        mi.Target(**values)


@pytest.mark.parametrize(
    "arguments",
    [
        {"free": ["colour"]},
        {"free": []},
        {"free": ["k", "k"]},
        {"free": ["k"], "bounds": {"k": (5.0, 6.0)}},
        {"free": ["k"], "targets": []},
    ],
)
def test_wrong_fits(arguments):
    target = mi.Target(quantity="pull-in voltage", value=30.0)
    with pytest.raises(mi.InvalidParameter):
        mi.fit(**{"actuator": DEVICE, "targets": [target], **arguments})
