"""Quantities with units, as people write them."""

from __future__ import annotations

import math

import pytest

import mems_impact as mi
from mems_impact._util.quantities import QuantityError, magnitude

READ = [
    ("4 um", "m", 4e-6), ("4um", "m", 4e-6), ("4 \N{MICRO SIGN}m", "m", 4e-6),
    ("4 \N{GREEK SMALL LETTER MU}m", "m", 4e-6), ("0.2 mg", "kg", 2e-7), ("1 g", "kg", 1e-3),
    ("0.6 kHz", "Hz", 600.0), ("600 Hz", "rad/s", 2 * math.pi * 600),
    ("2 rad/s", "Hz", 1 / math.pi),
    ("5 %", "", 0.05), ("5%", "", 0.05), ("30 deg", "rad", math.pi / 6),
    ("30 deg", "", math.pi / 6),
    ("11.4 uN/um", "N/m", 11.4), ("0.1 mm^2", "m^2", 1e-7),
    ("0.1 mm\N{SUPERSCRIPT TWO}", "m^2", 1e-7),
    ("1 pF", "F", 1e-12), ("1 M\N{GREEK CAPITAL LETTER OMEGA}", "ohm", 1e6),
    ("10 kohm", "ohm", 1e4),
    ("1 atm", "Pa", 101325.0), ("100 mbar", "Pa", 1e4), ("2.2e-20 F m", "F m", 2.2e-20),
    ("5 N*s/m", "N s/m", 5.0), ("-3e2 mV", "V", -0.3), ("2 ms", "s", 2e-3),
    ("60 rpm", "Hz", 1.0), ("1 kg m/s^2", "N", 1.0), ("1 J/m", "N", 1.0),
]  # fmt: skip


@pytest.mark.parametrize(("text", "unit", "value"), READ)
def test_read(text, unit, value):
    assert magnitude(text, unit) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize("number", ["0.1", "0.2", "0.3", "1.7", "4.9", "70.1"])
@pytest.mark.parametrize(("prefix", "power"), [("n", -9), ("u", -6), ("m", -3), ("k", 3)])
def test_prefixes_are_exact(number, prefix, power):
    assert magnitude(f"{number} {prefix}m", "m") == float(f"{number}e{power}")


@pytest.mark.parametrize(
    ("text", "unit"),
    [("4 V", "m"), ("4", "m"), ("x um", "m"), ("4 blah", "m"), ("4 Hz", "s"), ("inf um", "m"),
     ("4 um um", "m"), ("", "m"), ("4 kkg", "kg"), ("1 m^x", "m")],
)  # fmt: skip
def test_refused(text, unit):
    with pytest.raises(QuantityError, match="a number"):
        magnitude(text, unit)


def test_in_parameters():
    assert mi.Sine(amplitude="70 V", omega="0.6 kHz").omega == pytest.approx(2 * math.pi * 600)
    assert mi.Tilt(angle="3 deg").angle == pytest.approx(math.radians(3))
    mita = mi.load_actuator("mita2003")
    assert mita.replace(d="6 um").d == 6e-6
    assert mita.changed(e="70 %", **{"tilt.angle": "1 deg"}).e == 0.7
    system = mita.under(mi.Sine(amplitude=100, omega=6.0)).changed(amplitude="90 V", omega="1 Hz")
    assert (system.drive.amplitude, system.drive.omega) == (90.0, 2 * math.pi)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: mi.Sine(amplitude="70 m", omega=1.0), r"'70 m': must be a number \[V\]"),
        (lambda: mi.load_actuator("mita2003").replace(m1="3 V"), "such as \"0.2 mg\""),
        (lambda: mi.load_actuator("zhao2004").replace(d="4 um"), "the device is dimensionless"),
        (lambda: mi.Tilt(angle="3 V"), r"must be a number"),
    ],
)  # fmt: skip
def test_wrong_units_of_parameters(make, message):
    with pytest.raises(mi.InvalidParameter, match=message):
        make()


class PintQuantity:
    """A quantity as pint has it: a magnitude, and units with a short format."""

    class Units(str):
        __slots__ = ()

        def __format__(self, spec):
            assert spec == "~C"
            return str(self)

    def __init__(self, magnitude, units):
        self.magnitude, self.units = magnitude, self.Units(units)


def test_quantities_of_pint():
    assert mi.Sine(amplitude=PintQuantity(70, "V"), omega=PintQuantity(0.6, "kHz")).omega == (
        pytest.approx(2 * math.pi * 600)
    )
    assert magnitude(PintQuantity(5, "kg*m**2/s**2"), "J") == 5.0


def test_quantities_of_the_installed_pint():
    pint = pytest.importorskip("pint")
    registry = pint.UnitRegistry()
    assert magnitude(registry.Quantity(4, "micrometer"), "m") == pytest.approx(4e-6)
    assert magnitude(600 * registry.hertz, "rad/s") == pytest.approx(2 * math.pi * 600)
