"""Fits find parameters that are known, and say what the data leave open."""

import math

import numpy as np
import pytest

import mems_impact as mi

DEVICE = mi.load_actuator("mita2003")
SLOW = mi.Sine(amplitude=100.0, omega=2 * math.pi)
FASTER = mi.Sine(amplitude=60.0, omega=2 * math.pi)


def measured(device, drive):
    return mi.simulate(device, drive, 4, window=(2, 4)).blow_statistics.displacement_per_blow


@pytest.mark.slow
def test_two_parameters_are_found_again():
    targets = [
        mi.Target(quantity="displacement per blow", value=measured(DEVICE, SLOW), drive=SLOW),
        mi.Target(quantity="pull-in voltage", value=mi.pull_in_voltage(DEVICE), tolerance=0.5),
    ]
    start = DEVICE.replace(k=1.3 * DEVICE.k, alpha=0.8 * DEVICE.alpha)
    found = mi.fit(start, targets, free=["k", "alpha"])
    assert found.converged
    assert math.isclose(found.system.k, DEVICE.k, rel_tol=1e-5)
    assert math.isclose(found.system.alpha, DEVICE.alpha, rel_tol=1e-5)
    assert found.system.replace(k=start.k, alpha=start.alpha) == start
    assert np.abs(found.residuals["in standard errors"]).max() < 1e-3
    assert found.residuals["quantity"].tolist()[1] == "pull-in voltage [V]"
    assert found.parameters["parameter"].tolist() == ["k [N/m]", "alpha [F m]"]
    assert found.note == "the data determine all free parameters"
    assert found.verdict == "good"
    assert found.misfit == np.abs(found.residuals["in standard errors"]).max()
    assert (found.singular_values > 1).all()


def test_one_number_cannot_tell_two_parameters_apart():
    target = mi.Target(quantity="displacement per blow", value=21e-9, drive=SLOW)
    with pytest.warns(mi.FitWarning, match="undetermined: .* cannot separate alpha, k"):
        found = mi.fit(DEVICE, [target], free=["k", "alpha"])
    assert found.verdict == "undetermined"
    assert abs(found.residuals["in standard errors"][0]) < 1e-3
    assert "cannot separate" in found.note
    assert np.isinf(found.parameters["standard error"]).all()
    # Along the combination that the note names nothing changes, indeed.
    power = float(found.note.split("k^")[1].split()[0])
    moved = found.system.replace(k=found.system.k * 1.02**power, alpha=found.system.alpha * 1.02)
    assert math.isclose(measured(moved, SLOW), 21e-9, rel_tol=1e-3)


def test_a_parameter_that_no_target_feels():
    target = mi.Target(quantity="pull-in voltage", value=30.0)
    with pytest.warns(mi.FitWarning, match="add measurements"):
        found = mi.fit(DEVICE, [target], free=["k", "mu_s"])
    assert found.verdict == "undetermined"
    assert "the data do not determine mu_s" in found.note
    assert found.parameters["determined"].tolist() == [True, False]
    assert found.system.mu_s == DEVICE.mu_s
    assert math.isclose(mi.pull_in_voltage(found.system), 30.0, rel_tol=1e-6)


def test_a_bound_holds_and_is_reported():
    target = mi.Target(quantity="pull-in voltage", value=300.0)
    with pytest.warns(mi.FitWarning, match="misfit: the fit misses the datum"):
        found = mi.fit(DEVICE, [target], free=["k"], bounds={"k": (1.0, 10.0)})
    assert found.verdict == "misfit"
    assert found.system.k <= 10.0
    assert math.isclose(found.system.k, 10.0, rel_tol=1e-6)
    assert found.residuals["difference"][0] < -200.0
    assert "k is at its upper bound" in found.note


def test_a_count_cannot_be_fitted_and_the_note_says_so():
    targets = [
        mi.Target(quantity="displacement per blow", value=20e-9, drive=SLOW),
        mi.Target(quantity="blows per period", value=1.0, drive=SLOW),
    ]
    found = mi.fit(DEVICE, targets, free=["k"])
    assert "blows per period depends on none" in found.note
    assert found.residuals["computed"][1] == 1.0


@pytest.mark.parametrize("quantity", ["displacement per impact", "displacement per blow",
                                      "impacts per period", "blows per period",
                                      "displacement per period", "mean speed"])  # fmt: skip
def test_a_quantity_is_what_statistics_calls_so(quantity):
    # The number of a run is the target that the same device meets.
    run = mi.simulate(DEVICE, SLOW, 4, window=(2, 4))
    statistics = run.statistics
    target = mi.Target(quantity=quantity, value=statistics[quantity], drive=SLOW)
    assert target.computed(DEVICE, {SLOW: run}) == statistics[quantity]
    assert statistics["displacement per blow"] > 15 * statistics["displacement per impact"]


def test_a_misfit_is_said():
    # What a bounce does, given as what a blow does, which no restitution reaches.
    run = mi.simulate(DEVICE, SLOW, 4, window=(2, 4))
    bounce = run.statistics["displacement per impact"]
    target = mi.Target(quantity="displacement per blow", value=bounce, drive=SLOW, tolerance=1e-12)
    with pytest.warns(mi.FitWarning, match=r"misfit: .*per impact or per blow\?"):
        found = mi.fit(DEVICE.replace(e=0.7), [target], free=["e"])
    assert found.misfit > 1000
    assert found.misfit == np.abs(found.residuals["in standard errors"]).max()
    assert found.verdict == "misfit"
    drive = "displacement per blow [m] under Sine(amplitude = 100 V, omega = 6.28"
    assert f"by more than 3 standard errors, {drive}" in found.note
    assert f"by {found.misfit:.4g}" in found.note
    assert "the data determine all" not in found.note
    assert str(found).startswith(f"misfit: {found.note}\n")


@pytest.mark.slow
def test_a_fit_that_ends_at_a_jump_says_so():
    """With more damping nothing strikes, and the mean speed jumps to zero past the target."""
    device = mi.Actuator.from_design(
        frequency=1500, quality=20, proof_mass="0.1 mg", frame_mass="1.16 mg", gap="4 um",
        travel="2.2 um", pull_in=30, friction=(1.2, 0.9), restitution=0.6,
    )  # fmt: skip
    drive = mi.Sine(amplitude=30, frequency=750)
    targets = [
        mi.Target(quantity="resonance", value="1.4 kHz"),
        mi.Target(quantity="mean speed", value=320e-6, tolerance="5%", drive=drive),
    ]
    with pytest.warns(mi.FitWarning, match="misfit"):
        found = mi.fit(device, targets, ["k", "c"], transient=60, periods=10)
    computed = found.residuals["computed"][1]
    assert f"mean speed [m/s] jumps from {computed:.4g} to 0;" in found.note
    table = found.parameters.set_index("parameter")
    resonance_error = 2 * 0.01 * table.loc["k [N/m]", "fitted"]  # k is known from the resonance
    assert table.loc["k [N/m]", "standard error"] < 1.02 * resonance_error
    damped = found.system.replace(c=1.02 * found.system.c)
    run = mi.simulate(damped, drive, 70, window=(60, 70))
    assert run.statistics["impacts per period"] == 0.0


def test_a_steep_slope_is_no_jump():
    """The resting voltage is a square root of k delta - F: continuous, steep near its zero."""
    force = (1.0 - 2e-5) * DEVICE.k * DEVICE.delta
    device = DEVICE.adding(mi.Adhesion(force=force))
    voltage = mi.resting_voltage(device)
    assert mi.resting_voltage(device.replace(k=1.0001 * device.k)) > 2.0 * voltage
    target = mi.Target(quantity="resting voltage", value=voltage, tolerance=1e-3)
    found = mi.fit(device, [target], free=["k"])
    assert found.note == "the data determine all free parameters"
    assert 0.0 < found.parameters["standard error"].iloc[0] < 1e-4 * device.k


def test_a_parameter_known_to_less_than_its_size_is_said():
    # It is the size of the error that tells: there is no other parameter to compare with.
    target = mi.Target(quantity="pull-in voltage", value=30.0, tolerance=100.0)
    with pytest.warns(mi.FitWarning, match="undetermined"):
        found = mi.fit(DEVICE, [target], free=["k"])
    row = found.parameters.iloc[0]
    ratio = row["standard error"] / row["fitted"]
    assert 1.0 < ratio < 10.0
    assert not row["determined"]
    assert found.misfit < 1e-3
    assert found.verdict == "undetermined"
    assert found.note.startswith("the data do not determine k: its standard error is ")


def test_a_fit_that_begins_where_nothing_happens_says_so():
    quiet = SLOW.replace(amplitude=10.0)  # far below pull-in
    target = mi.Target(quantity="displacement per impact", value=20e-9, drive=quiet)
    with pytest.warns(mi.FitWarning, match="misfit"):
        found = mi.fit(DEVICE, [target], free=["e"])
    assert found.residuals["computed"][0] == 0.0
    assert "the data do not determine e" in found.note


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
        {"free": ["k"], "data": []},
        {"free": ["k"], "bounds": {"alpha": (1e-20, 1e-18)}},
    ],
)
def test_wrong_fits(arguments):
    target = mi.Target(quantity="pull-in voltage", value=30.0)
    with pytest.raises(mi.InvalidParameter):
        mi.fit(**{"system": DEVICE, "data": [target], **arguments})


@pytest.mark.slow
def test_a_value_at_a_limit_of_the_device_is_named_and_has_a_derivative_from_within():
    """The speed is smooth up to mu_d = mu_s, beyond which there is no device."""
    device, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
    given = {"initial": mi.kicked_state(device)}
    limit = device.replace(mu_d=device.mu_s)
    run = mi.simulate(limit, drive, periods=400, window=(300, 400), **given)
    speed = mi.Target(quantity="mean speed", value=run.statistics["mean speed"], drive=drive)
    found = mi.fit(
        device.replace(mu_d=0.7 * device.mu_s), [speed], ["mu_d"], transient=300, **given
    )
    assert found.system.mu_d == pytest.approx(device.mu_s, rel=1e-3)
    assert found.note.startswith("mu_d is at a limit of the system")
    assert found.note.endswith("must be <= 0.4, which is mu_s")
    assert not any(word in found.note for word in ("jumps", "depends on none", "determine"))
    assert 0.0 < found.parameters["standard error"].iloc[0] < math.inf
