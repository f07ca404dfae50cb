"""Numbers in other units are told once; such as devices have are not."""

import math
import re
import warnings

import pytest

import mems_impact as mi
from mems_impact.actuator import ranges

MITA = mi.load_actuator("mita2003")
DRIVE = mi.Sine(amplitude=60.0, omega=1885.0)


@pytest.fixture(autouse=True)
def nothing_told():
    ranges._tell.cache_clear()


def told(act):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        act()
    return [str(each.message) for each in caught if each.category is mi.UnitsWarning]


def look(target):
    ranges.look_at_target(MITA, target.quantity, target.value, target.unit)


@pytest.mark.parametrize(
    ("changes", "meant"),
    [
        ({"d": 4.0}, "d = 4 m, .*; 4 um\\?"),
        ({"d": 0.005}, "d = 0.005 m, .*; 0.005 mm\\?"),
        ({"m1": 10.485}, "m1 = 10.485 kg, .*; 10.485 (mg|ug)\\?"),
        ({"mu_s": 35.0}, "mu_s = 35, .*; 35 %\\?"),
        ({"alpha": 2e-8}, "an area of 2e-08 m.2, of which alpha is 8.854e-20 F m"),
        ({"g": 981.0}, "g = 981 m/s"),
    ],
)
def test_a_device_in_other_units(changes, meant):
    device = MITA.replace(**changes)
    found = told(lambda: [device.under(DRIVE) for _ in range(2)])
    assert len(found) == 1
    assert re.search(meant, found[0])


@pytest.mark.parametrize(
    ("drive", "meant"),
    [
        (mi.Sine(amplitude=60.0, omega=2.0 * math.pi * 0.12), "0.12 kHz?"),
        (
            mi.Sampled(times=(0.0, 400.0, 800.0), voltages=(0.0, 1.0, 0.5), period=1111.0),
            "1111 us?",
        ),
        (mi.Sine(amplitude=6e4, omega=1885.0), "60000 mV?"),
        (mi.Burst(wave=mi.Sine(amplitude=6e4, omega=1885.0), on=3, off=2), "wave.amplitude"),
    ],
)
def test_a_voltage_in_other_units(drive, meant):
    found = told(lambda: MITA.under(drive))
    assert found
    assert any(meant in each for each in found)


def test_a_resonance_in_hertz():
    own = math.sqrt(MITA.k / MITA.m2)
    for value, count in ((own / (2.0 * math.pi), 1), (own, 0), (0.7 * own, 0)):
        target = mi.Target(quantity="resonance", value=value)
        assert len(told(lambda target=target: look(target))) == count
    target = mi.Target(quantity="pull-in voltage", value=35e3)
    assert "35000 mV?" in told(lambda: look(target))[0]


def test_what_such_devices_have_is_not_told():
    """The presets, as they are driven in the paper; an order beyond them; none without units."""
    sets = [{}]
    for name in ("m1", "m2", "k", "c", "alpha"):
        sets += [{name: factor * getattr(MITA, name)} for factor in (0.1, 10.0)]
    sets += [{"d": 5e-5}, {"d": 5e-7, "delta": 2.5e-7}, {"mu_s": 1.5}, {"g": 0.0}]
    slow = mi.Sine(amplitude=100.0, omega=6.283)

    def all_of_them():
        for changes in sets:
            MITA.replace(**changes).under(DRIVE)
        for drive in (slow, mi.Sine(amplitude=1e3, omega=1e5), mi.Sine(amplitude=0.0, omega=1e4)):
            MITA.under(drive)
        strange = mi.load_actuator("zhao2004").replace(m1=5e3, d=4.0, mu_s=35.0, alpha=7.0)
        strange.under(mi.Sine(amplitude=1e6, omega=1e-3))

    assert told(all_of_them) == []
