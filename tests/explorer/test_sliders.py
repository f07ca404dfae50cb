import math

import pytest

import mems_impact as mi
from mems_impact.actuator.parameters import PARAMETER_MEANINGS, PARAMETER_NAMES
from mems_impact.explorer.session import allowed_range, best_si_prefix, slider_specs
from tests.explorer.subjects import mita, own, slider_spec, zhao


@pytest.mark.parametrize("subject", [zhao, mita, own])
def test_every_parameter_has_a_slider_around_its_value(subject):
    subject = subject()
    specs = slider_specs(subject)
    assert [each.name for each in specs] == list(subject.system.parameters)
    assert sorted(name for names in subject.groups.values() for name in names) == sorted(
        subject.system.parameters
    )
    for each in specs:
        value = subject.system.parameters[each.name]
        assert each.low <= value <= each.high
        assert 0.0 < each.step < each.high - each.low
        for end in (each.low, each.high):
            subject.system.changed(**{each.name: end})  # allowed


def test_ranges_end_where_the_device_allows_no_more():
    ends = {each.name: (each.low, each.high) for each in slider_specs(zhao())}
    assert ends["e"] == (0.0, 1.0)
    assert ends["amplitude"] == (0.0, 0.48)
    assert 0.0 < ends["delta"][0] < 0.01
    assert 0.99 < ends["delta"][1] < 1.0  # d
    assert ends["mu_s"][0] == pytest.approx(0.27, abs=0.003)  # mu_d
    assert ends["m1"][0] > 0.0
    assert ends["phase"] == pytest.approx((-math.pi, math.pi), rel=1e-5)
    assert ends["bias"] == (-0.24, 0.24)


def test_a_range_is_that_of_the_values_that_go_with_it():
    system = zhao().system.changed(delta=0.2, d=0.5)
    low, high = allowed_range(system, "delta", 0.0, 1.0)
    assert 0.0 < low < 0.01
    assert 0.49 < high < 0.5


def test_a_device_in_si_has_units_that_fit_its_numbers():
    labels = {each.name: each.label for each in slider_specs(mita())}
    assert labels["m1"] == "m1 [mg]"
    assert labels["d"] == "d [µm]"
    assert labels["amplitude"] == "amplitude [V]"
    assert labels["c"] == "c [µN s/m]"
    assert labels["e"] == "e"
    assert slider_spec(mita(), "d").factor == 1e-6


def test_an_angular_frequency_with_a_unit_is_reported_in_hertz():
    omega = slider_spec(mita(), "omega")
    assert omega.title == "frequency omega/2π [Hz]"
    assert omega.displayed(750.0) == pytest.approx(750.0 / (2.0 * math.pi), rel=1e-14)
    assert omega.value(119.366) == pytest.approx(119.366 * 2.0 * math.pi, rel=1e-14)
    steps = omega.step / omega.factor
    assert f"{steps:.9e}"[0] in "125"
    assert f"{steps:.9e}"[1:11] == ".000000000"
    assert slider_spec(zhao(), "omega").title == "angular frequency omega"  # has no unit


def test_names_stand_beside_symbols():
    assert slider_spec(mita(), "k").title == "stiffness k [N/m]"
    assert slider_spec(zhao(), "delta").title == "stopper distance delta"
    assert slider_spec(zhao(), "amplitude").title == "amplitude"
    assert slider_spec(own(), "zeta").title == "zeta"
    assert set(PARAMETER_NAMES) < set(PARAMETER_MEANINGS)


def test_what_is_typed_into_a_field_is_the_parameter():
    mass = slider_spec(mita(), "m1")
    for number in (2.097, 0.3, 7.0):
        assert mass.value(number) == float(f"{number}e-6")
        assert mass.displayed(mass.value(number)) == number


def test_a_place_on_the_diagram_is_a_step_of_the_slider():
    omega = slider_spec(zhao(), "omega")
    value = omega.nearest(0.43217, 0.0, 1.0)
    assert value == pytest.approx(0.43217, abs=0.5 * omega.step)
    assert value / omega.step == pytest.approx(round(value / omega.step))
    assert omega.nearest(7.0, 0.1, 0.9) == 0.9


@pytest.mark.parametrize(
    ("unit", "size", "told"),
    [
        ("m", 2.5e-6, "µm"),
        ("m", 2e-8, "nm"),
        ("kg", 2.097e-6, "mg"),
        ("kg", 0.0, "kg"),
        ("N s/m", 6.3e-4, "µN s/m"),
        ("F m", 8.854e-20, "zF m"),
        ("V", 100.0, "V"),
        ("Hz", 5e4, "kHz"),
        ("m/s^2", 9.81, "m/s^2"),
        ("rad/s", 1e6, "rad/s"),
        ("1/m", 1e6, "1/m"),
        ("", 1e-9, ""),
    ],
)
def test_units_take_the_prefix_that_fits(unit, size, told):
    factor, name = best_si_prefix(unit, size)
    assert name == told
    if told != unit:
        assert 1.0 <= size / factor < 1000.0


def test_a_prefix_is_a_power_of_a_thousand():
    for power in range(-22, 9):
        factor, _ = best_si_prefix("m", 1.5 * 10.0**power)
        assert 0.1 <= 1.5 * 10.0**power / factor < 1e4
        assert math.log10(factor) == pytest.approx(3 * round(math.log10(factor) / 3))


def test_sliders_of_terms_stand_under_their_name():
    from mems_impact.explorer.session import subject_of_device

    device = mi.load_actuator("zhao2004").adding(mi.Tilt(angle=0.05))
    subject = subject_of_device("zhao2004", device, mi.Sine(amplitude=0.2, omega=0.5))
    assert subject.groups["tilt"] == ("tilt.angle",)
    assert slider_spec(subject, "tilt.angle").high == pytest.approx(0.1)
