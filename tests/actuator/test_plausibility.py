"""Numbers in other units are told once; such as devices have are not."""

import math
import re
import warnings

import pytest

import mems_impact as mi
from mems_impact.actuator import plausibility
from mems_impact.actuator.terms import TERM_CLASSES
from mems_impact.actuator.terms.files import term_type

MITA = mi.load_actuator("mita2003")
DRIVE = mi.Sine(amplitude=60.0, omega=1885.0)


@pytest.fixture(autouse=True)
def nothing_told():
    plausibility._warn_once.cache_clear()


def warnings_of(act):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        act()
    return [str(each.message) for each in caught if each.category is mi.UnitsWarning]


def look(target):
    plausibility.check_plausible_target(MITA, target.quantity, target.value, target.unit)


@pytest.mark.parametrize(
    ("changes", "meant"),
    [
        ({"d": 4.0}, "gap d = 4 m, .*; 4 um\\?"),
        ({"d": 0.005}, "d = 0.005 m, .*; 5 um\\?"),
        ({"m1": 0.01}, "m1 = 0.01 kg, .*; 10 ug\\?"),
        ({"m1": 10.485}, "m1 = 10.485 kg, .*; 10.485 (mg|ug)\\?"),
        ({"mu_s": 35.0}, "mu_s = 35, .*; 35 %\\?"),
        ({"alpha": 2e-8}, "an area of 2e-08 m.2, for which alpha is 8.854e-20 F m"),
        ({"g": 981.0}, "g = 981 m/s"),
    ],
)
def test_a_device_in_other_units(changes, meant):
    device = MITA.replace(**changes)
    found = warnings_of(lambda: [device.under(DRIVE) for _ in range(2)])
    assert len(found) == 1
    assert re.search(meant, found[0])


def test_a_wrong_gap_is_not_reported_as_a_wrong_electrode_too():
    sheet = {**MITA.datasheet, "gap": 5.0}  # um; the pull-in voltage then gives a huge alpha
    del sheet["electrode_area"], sheet["capacitance"], sheet["electrode_constant"]
    del sheet["release"]
    device = mi.Actuator.from_design(**sheet)
    assert device.alpha > plausibility.DEVICE_RANGES["alpha"].high
    (found,) = warnings_of(lambda: device.under(DRIVE))
    assert found.startswith("gap d = 5 m")


def test_every_number_of_a_term_has_a_range():
    """Pure numbers, which have no unit, are within limits of their own."""
    for name in TERM_CLASSES:
        term = term_type(name)
        fields = term.model_fields.keys()
        assert term.units.keys() & fields <= term.plausible.keys() <= fields


AIR = {"length": 2e-4, "width": 1e-4, "pressure": 1e5, "viscosity": 1.82e-5}
AIR["free_path_pressure"] = 6.7e-3


@pytest.mark.parametrize(
    ("term", "meant"),
    [
        (mi.Tilt(angle=1.0), "tilt.angle = 1 rad, .*; 1 deg\\?"),
        (mi.FrameSpring(k1=2e-5), "k1 = 2e-05 N/m, .*; 2e-05 N/um\\?"),
        (mi.CubicStiffness(k3=-2e-8), "k3 = -2e-08 N/m.3, .*; -2e-08 N/um.3\\?"),
        (mi.FrameForce(force=-20.0), "force = -20 N, .*; -20 uN\\?"),
        (mi.SqueezeFilm(**{**AIR, "length": 200.0}), "squeeze_film.length = 200 m, .*; 200 um\\?"),
        (mi.SqueezeFilm(**{**AIR, "viscosity": 18.2}), "viscosity = 18.2 Pa s, .*; 18.2 uPa s\\?"),
        (
            mi.SqueezeFilm(**{**AIR, "free_path_pressure": 6.7e-8}),
            "6.7e-08 m, the mean free path alone\\?",
        ),
        (
            mi.SeriesResistance(resistance=1e4, parasitic_capacitance=3.0),
            "parasitic_capacitance = 3 F, .*; 3 pF\\?",
        ),
        (mi.Fringing(width=100.0), "fringing.width = 100 m, .*; 100 um\\?"),
        (mi.CompliantStopper(stiffness=2e13), "stiffness = 2e.13 N/m, outside the range"),
        (mi.DielectricCharging(share=0.3, time=1e12), "time = 1e.12 s, .*; 1e.12 ns\\?"),
        (mi.PowerLawRestitution(speed=5e3), "speed = 5000 m/s, .*; 5000 [mu]m/s\\?"),
        (mi.TabulatedRestitution(speeds=(0.0, 5e3), values=(0.9, 0.5)), "speeds = 5000 m/s"),
        (mi.StribeckFriction(speed=5e3), "stribeck_friction.speed = 5000 m/s"),
        (mi.RegularizedFriction(width=5e3), "regularized_friction.width = 5000 m/s"),
    ],
)
def test_a_term_in_other_units(term, meant):
    device = MITA.adding(term)
    found = warnings_of(lambda: [device.under(DRIVE) for _ in range(2)])
    assert len(found) == 1
    assert re.search(meant, found[0])


SLOW = mi.Sine(amplitude=20.0, omega=2.0 * math.pi * 0.12)  # pull-in is at 31.6 V


@pytest.mark.parametrize(
    ("drive", "meant"),
    [
        (
            SLOW,
            "frequency = 0.12 Hz lies far below the resonance, 239.9 Hz, where the block ",
        ),
        (SLOW, "31.57 V to reach a stopper; 0.12 kHz?"),
        (mi.Burst(wave=SLOW, on=3, off=2), "wave.frequency = 0.12 Hz"),
        (mi.Voltages(right=SLOW, left=SLOW), "left.frequency = 0.12 Hz"),
        (mi.Sine(amplitude=20.0, frequency=5.7e6), "5.7e+06 Hz lies far above the resonance"),
        (mi.Burst(wave=DRIVE, on=3, pause=500.0), "period = 500.005 s"),
        (
            mi.Sampled(times=(0.0, 400.0, 800.0), voltages=(0.0, 1.0, 0.5), period=1111.0),
            "1111 us?",
        ),
        (mi.Sine(amplitude=6e4, omega=1885.0), "60000 mV?"),
        (mi.Burst(wave=mi.Sine(amplitude=6e4, omega=1885.0), on=3, off=2), "wave.amplitude"),
    ],
)
def test_a_voltage_in_other_units(drive, meant):
    found = warnings_of(lambda: MITA.under(drive))
    assert found
    assert any(meant in each for each in found)


def test_a_resonance_in_hertz():
    own = math.sqrt(MITA.k / MITA.m2)
    for value, count in ((own / (2.0 * math.pi), 1), (own, 0), (0.7 * own, 0)):
        target = mi.Target(quantity="resonance", value=value)
        assert len(warnings_of(lambda target=target: look(target))) == count
    target = mi.Target(quantity="pull-in voltage", value=35e3)
    assert "35000 mV?" in warnings_of(lambda: look(target))[0]


# As if at rest, but the block is pulled in; not that slow; without any voltage.
SLOWLY = ((32.0, 0.12), (60.0, 0.6), (100.0, 0.16), (20.0, 1.0), (0.0, 0.12))


def test_what_such_devices_have_is_not_reported():
    """The presets, as they are driven in the paper; an order beyond them; none without units."""
    sets = [{}]
    for name in ("m1", "m2", "k", "c", "alpha"):
        sets += [{name: factor * getattr(MITA, name)} for factor in (0.1, 10.0)]
    sets += [{"d": 5e-5}, {"d": 5e-7, "delta": 2.5e-7}, {"mu_s": 1.5}, {"g": 0.0}]
    slow = mi.Sine(amplitude=100.0, omega=6.283)
    terms = (
        mi.SqueezeFilm(**{**AIR, "pressure": 0.1}),
        mi.SeriesResistance(resistance=1e9),
        mi.CompliantStopper(stiffness=1e12, exponent=1.5, damping=10.0),
        mi.Adhesion(force=1e-6),
        mi.CubicStiffness(k3=2e10),
        mi.Tilt(angle=-0.3),
        mi.Fringing(width=1e-3),
    )

    def all_of_them():
        for changes in sets:
            MITA.replace(**changes).under(DRIVE)
        MITA.adding(*terms).under(DRIVE)
        for volts, hertz in SLOWLY:
            MITA.under(mi.Sine(amplitude=volts, omega=2.0 * math.pi * hertz))
        for drive in (slow, mi.Sine(amplitude=1e3, omega=1e5), mi.Sine(amplitude=0.0, omega=1e4)):
            MITA.under(drive)
        strange = mi.load_actuator("zhao2004").replace(m1=5e3, d=4.0, mu_s=35.0, alpha=7.0)
        strange = strange.adding(mi.Tilt(angle=1.2), mi.FrameSpring(k1=1e9))
        strange.under(mi.Sine(amplitude=1e6, omega=1e-3))

    assert warnings_of(all_of_them) == []
