"""The numbers of a problem, made without checked objects, to the last bit."""

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.units import DeviceScales
from mems_impact.orbits.family import Family

SCALES = DeviceScales.of_device(m2=1.7e-9, k=1.3, d=2.1e-6, alpha=3.3e-18)
ZHAO = mi.load_actuator("zhao2004")


@pytest.mark.parametrize("device", [ZHAO, ZHAO.to_si(SCALES)], ids=["dimensionless", "SI"])
@pytest.mark.parametrize("kind", [mi.Sine, mi.Square])
def test_a_family_has_the_numbers_of_its_problems(device, kind):
    volt, second = (
        (device.scales.unit(name) for name in ("V", "s")) if device.units == "SI" else (1, 1)
    )
    drive = kind(amplitude=0.24 * volt, omega=0.5 / second)
    family = device.under(drive).family(mi.Options())
    for name, value in family.values.items():
        changed = 1.003 * value if value else 1e-3
        problem = family.at(**{name: changed}).problem()
        numbers = family.numbers(**{name: changed})
        np.testing.assert_array_equal(numbers.parameters, problem.parameters)
        assert numbers[1:] == problem.numbers[1:]


def test_differences_look_beyond_the_range_of_a_parameter():
    family = ZHAO.replace(e=1.0).under(mi.Sine(amplitude=0.0, omega=0.5)).family(mi.Options())
    for name in ("e", "amplitude"):
        rates, period, _ = family.derivative(name)
        assert np.count_nonzero(rates) == 1
        assert rates.max() == pytest.approx(1.0, abs=1e-12)
        assert period == 0.0


@pytest.mark.parametrize("device", [ZHAO, ZHAO.to_si(SCALES)], ids=["dimensionless", "SI"])
@pytest.mark.parametrize("bias", [0.0, 0.1])
def test_derivatives_by_the_frequency_are_exact(device, bias):
    volt, second = (
        (device.scales.unit(name) for name in ("V", "s")) if device.units == "SI" else (1, 1)
    )
    drive = mi.Sine(amplitude=0.24 * volt, bias=bias * volt, omega=0.5 / second)
    family = device.under(drive).family(mi.Options()).at(omega=0.48)
    rates, of_period, _ = family.derivative("omega")
    assert of_period == pytest.approx(-family.numbers().period / 0.48, rel=5e-15)
    differences, *_ = Family.derivative(family, "omega")
    np.testing.assert_allclose(rates, differences, rtol=0, atol=1e-10)
    assert rates.max() == pytest.approx(1.0, rel=5e-15)
