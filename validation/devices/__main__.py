"""Predicted beside measured: ``python -m validation.devices``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pandas as pd

import mems_impact as mi

HERE = Path(__file__).parent
UM, US = 1e-6, 1e6


class Row(NamedTuple):
    """A measured number, and the one of the drawing."""

    device: str
    quantity: str
    unit: str
    measured: float
    ours: float


class Fingers(NamedTuple):
    """Measurements of `rauf2022` with fingers of another overlap: means of three devices."""

    overlap: float  # um
    pull_in: float  # V
    release: float
    closing: dict[int, float]  # us after a step of the voltage [V]


# github.com/ahadrauf/gca_dynamics, data/20180208_fawn_gca_V_fingerL_pullin_release.mat
IN_AIR = (
    Fingers(15.3, 34.03, 18.0, {50: 37.4, 70: 24.6}),
    Fingers(22.95, 31.03, 14.5, {50: 34.9, 70: 23.4}),
    Fingers(30.6, 25.17, 12.2, {50: 28.3, 70: 19.3}),
    Fingers(38.25, 24.20, 11.3, {50: 28.2, 70: 19.4}),
    Fingers(45.9, 22.03, 10.6, {50: 26.4, 70: 18.2}),
    Fingers(53.55, 20.40, 9.7, {50: 25.0, 70: 17.3}),
    Fingers(61.2, 18.83, 8.8, {50: 23.7, 70: 16.3}),
    Fingers(68.85, 17.63, 8.4, {50: 23.0, 70: 15.9}),
    Fingers(76.5, 16.57, 8.0, {50: 23.1, 70: 15.4}),
)
# … data/20180208_fawn_gca_V_fingerL_pullin_underwater.mat: overlap [um], then us by voltage [V]
IN_WATER = {
    25: {4.1492: 376.6, 5.1153: 190.5},
    55: {2.9580: 1510.1, 3.9091: 671.1},
    85: {3.1864: 1770.5, 4.1610: 927.4},
    115: {3.1979: 1676.2, 4.1524: 914.3},
}
# Mean of five at 1 MHz in 0.1 mM KCl, 4 V from peak to peak: gap [um], combs, displacement [um]
COMBS = {"T3": (5.0, 4, 1.233), "T4": (2.0, 8, 5.209)}
FINGERS_OF_A_COMB = 25
ROOT_MEAN_SQUARE = 2.0**0.5


def in_air() -> Iterator[Row]:
    """Yield the rows of the preset with all lengths of fingers."""
    preset = mi.load_actuator("rauf2022")
    for fingers in IN_AIR:
        device = _with_overlap(preset, fingers.overlap)
        name = f"in air, {fingers.overlap:g} um"
        yield Row(name, "pull-in", "V", fingers.pull_in, mi.pull_in_voltage(device))
        yield Row(name, "release", "V", fingers.release, mi.resting_voltage(device))
        for volts, measured in fingers.closing.items():
            yield Row(name, f"closing at {volts} V", "us", measured, _closing(device, volts))


def in_water() -> Iterator[Row]:
    """Yield the rows of the actuator in water."""
    drawing = mi.load_actuator(HERE / "liquid.toml")
    for overlap, closings in IN_WATER.items():
        device = _with_overlap(drawing, overlap)
        for volts, measured in closings.items():
            quantity = f"closing at {volts:.1f} V"
            yield Row(f"in water, {overlap} um", quantity, "us", measured, _closing(device, volts))


def combs() -> Iterator[Row]:
    """Yield the rows of the comb drives: the second has the stiffness of the first."""
    drawing = mi.load_actuator(HERE / "comb.toml")
    for name, (gap, count, measured) in COMBS.items():
        numbers = {"gap": gap * UM, "count": float(count * FINGERS_OF_A_COMB)}
        device = drawing.changed(**{f"geometry.electrodes.{n}": v for n, v in numbers.items()})
        share = (ROOT_MEAN_SQUARE / mi.resting_voltage(device)) ** 2
        yield Row(f"comb {name}", "deflection", "um", measured, share * device.delta / UM)


def _with_overlap(device: mi.Actuator, overlap: float) -> mi.Actuator:
    root = 10.0  # um, without overlap
    lengths = {"overlap": overlap, "length": overlap + root}
    return device.changed(**{f"geometry.electrodes.{n}": v * UM for n, v in lengths.items()})


def _closing(device: mi.Actuator, volts: float) -> float:
    return US * mi.closing(device, mi.VoltageStep(amplitude=volts)).closing_time


def table() -> pd.DataFrame:
    """Return all rows."""
    found = pd.DataFrame([*in_air(), *in_water(), *combs()])
    found["ours/measured"] = found["ours"] / found["measured"]
    return found


if __name__ == "__main__":
    print(table().to_string(index=False, float_format="{:.3g}".format))
