"""Runs in SI are the dimensionless runs, with units beside the headings."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.units import COLUMN_UNITS, DeviceScales
from mems_impact.tables import unit_of, with_units

SCALES = DeviceScales.of_device(2.1e-6, 4.7, 5e-6, 8.9e-20)
PAPER = mi.load_actuator("zhao2004")
SI = PAPER.to_si(SCALES)
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
VOLTS = mi.Sine(amplitude=0.24 * SCALES.voltage, omega=0.5 / SCALES.time)
START = mi.State(x1=0.25, x2=-0.1, v2=0.4, time=1.0)


@pytest.fixture(scope="module")
def pair():
    start = mi.State(
        x1=START.x1 * SCALES.length,
        x2=START.x2 * SCALES.length,
        v2=START.v2 * SCALES.length / SCALES.time,
        time=START.time * SCALES.time,
    )
    window = (10.0, 40.0)
    plain = mi.simulate(PAPER, DRIVE, 60, initial=START, window=window)
    return plain, mi.simulate(SI, VOLTS, 60, initial=start, window=window)


def same(plain, scaled):
    """Whether a table in SI is the dimensionless one, unit by unit, to 1e-9 of its size."""
    assert list(scaled.columns) == list(plain.columns)
    assert plain.attrs["units"] == {}
    for name, heading in zip(plain.columns, with_units(scaled).columns, strict=True):
        unit = unit_of(name, COLUMN_UNITS)
        assert scaled.attrs["units"].get(name, "") == unit
        assert heading == (f"{name} [{unit}]" if unit else name)
        if plain[name].dtype.kind != "f":
            assert plain[name].tolist() == scaled[name].tolist()
            continue
        wanted = plain[name].to_numpy() * (SCALES.unit(unit) if unit else 1.0)
        size = np.nanmax(np.abs(wanted), initial=0.0)
        np.testing.assert_allclose(scaled[name], wanted, rtol=1e-9, atol=1e-9 * size)


@pytest.mark.parametrize("table", ["impacts", "events"])
def test_tables(pair, table):
    plain, scaled = pair
    assert len(getattr(plain, table)) >= 50
    same(getattr(plain, table), getattr(scaled, table))


def test_section_and_samples(pair):
    plain, scaled = pair
    same(plain.section(1), scaled.section(1))
    same(plain.samples(50, 3, 9), scaled.samples(50, 3, 9))


def test_statistics(pair):
    plain, scaled = pair
    frames = []
    for run in pair:
        frames.append(run.statistics.to_frame().T)
        frames[-1].attrs = run.statistics.attrs
    same(*frames)
    assert plain.window == scaled.window
    assert math.isclose(plain.periods, scaled.periods, rel_tol=1e-12)


def test_a_block_on_its_stopper_stays_within_it():
    # Scaling back rounds; the last state must be one that a run accepts.
    for d in np.linspace(1e-6, 9e-6, 23):
        scales = DeviceScales.of_device(2.1e-6, 4.7, d, 8.9e-20)
        device = PAPER.to_si(scales)
        held = mi.Sine(amplitude=0.0, omega=1.0 / scales.time, bias=0.5 * scales.voltage)
        run = mi.simulate(device, held, 10, initial=mi.State(x2=device.delta))
        assert run.final.x2 == device.delta
        mi.simulate(device, held, 0.1, initial=run.final)


def test_states_out_of_range_are_said_in_si():
    limits = r"between the stoppers at -2\.5e-06 and 2\.5e-06 m$"
    with pytest.raises(mi.InvalidParameter, match=limits):
        mi.simulate(SI, VOLTS, 1, initial=mi.State(x2=1e-3))
    with pytest.raises(mi.InvalidParameter, match="below the forcing period"):
        mi.simulate(SI, VOLTS, 1, initial=mi.State(time=1.0))
