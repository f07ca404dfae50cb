"""A drive is found under which a device walks, or the reason why there is none, and a remedy."""

import re

import pytest

import mems_impact as mi

RESONANT = mi.Actuator.from_design(
    frequency="1.2 kHz", quality=30, proof_mass="0.2 mg", frame_mass="1 mg", gap="4 um",
    travel="2.5 um", pull_in="70 V", friction=(0.35, 0.28), restitution=0.65,
)  # fmt: skip
HIGH_Q = mi.Actuator.from_design(
    frequency="12 kHz", quality=500, proof_mass="0.02 mg", frame_mass="0.2 mg", gap="2 um",
    travel="1 um", pull_in="90 V", friction=(0.3, 0.25), restitution=0.7,
)  # fmt: skip
OVERDAMPED = mi.Actuator.from_design(
    frequency="2 kHz", quality=0.3, proof_mass="0.1 mg", frame_mass="1 mg", gap="3 um",
    travel="2 um", pull_in="40 V", friction=(0.4, 0.3), restitution=0.5,
)  # fmt: skip


DEVICES = {
    "resonant": (RESONANT, 300),
    "high Q": (HIGH_Q, 1000),
    "overdamped": (OVERDAMPED, 20),
    "dimensionless": (mi.load_actuator("zhao2004"), 300),
}


@pytest.mark.filterwarnings("ignore::mems_impact.errors.TransientWarning")
@pytest.mark.parametrize(("device", "periods"), DEVICES.values(), ids=DEVICES)
def test_the_drive_is_that_of_a_stable_orbit_reached_from_rest(device, periods):
    drive = mi.walking_drive(device)
    orbit = mi.find_orbit(device, drive, guess=mi.State(), periods=1, transient=periods)
    assert orbit.stable
    assert len(orbit.impacts) > 0
    for factor in (0.95, 1.05):
        near = drive.replace(amplitude=factor * drive.amplitude)
        statistics = mi.simulate(device, near, periods).statistics
        assert statistics["blows per period"] == pytest.approx(1.0, abs=1.0 / periods)
        assert statistics["displacement per period"] * orbit.step > 0.0
        assert abs(statistics["displacement per period"]) > 1e-4 * device.delta


def test_amplitudes_stay_below_the_breakdown_of_the_gap():
    narrow = RESONANT.replace(d=1e-6, delta=0.6e-6, alpha=RESONANT.alpha / 20.0)
    assert mi.pull_in_voltage(narrow) > 33.0  # 330 V per 4 um, times 0.4 um
    assert mi.walking_drive(narrow).amplitude < 33.0


@pytest.mark.parametrize(
    ("device", "reason", "parameter", "unit"),
    [
        (mi.load_actuator("abdulrahim2016"), "as heavy as the block", "m1", 1e-6),
        (RESONANT.replace(k=1000.0), "breakdown of the narrowest gap", "k", 1.0),
    ],
)
def test_without_a_walk_the_remedy_makes_one(device, reason, parameter, unit):
    with pytest.raises(mi.OrbitError, match=reason) as refused:
        mi.walking_drive(device)
    value = float(re.search(rf"{parameter} = ([\d.e+-]+) ", refused.value.remedy)[1])
    assert value * unit < getattr(device, parameter)
    assert mi.walking_drive(device.replace(**{parameter: value * unit})).amplitude > 0.0


def test_a_frame_without_friction_does_not_walk():
    with pytest.raises(mi.OrbitError, match="give the frame friction"):
        mi.walking_drive(RESONANT.replace(mu_s=0.0, mu_d=0.0))
