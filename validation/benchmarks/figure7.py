"""Fig. 7 by curves, beside what brute force costs for the same boundaries."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

import mems_impact as mi
from validation.benchmarks.contestants import PERIODIC, heyoka
from validation.benchmarks.timing import Row, Spread, ratio

FREQUENCIES = 71  # omega from 0.44 to 0.51 in steps of 0.001
# Brute force finds a switch to half a step of the amplitude. A step of 1e-4 is far from the digits
# of the curves, and is what the paper's figure needs.
STEP, LOW, HIGH = 1e-4, 0.16, 0.34
PERIODS = 10_000  # of heyoka, at a tolerance of 1e-9: the unit of the curves' time
SAMPLE = 20  # amplitudes of one sweep that are timed; the rest is counted up from them


def figure7(quick: bool) -> Iterator[Row]:
    """All curves of the chart (no crisis is simulated), and a sample of the sweeps."""
    actuator = mi.load_actuator("zhao2004")
    mi.operating_chart(actuator, crises=0)  # compiles
    rival = heyoka(PERIODIC, 1e-9)
    rival(100)
    seconds, units, sweeps = [], [], []
    values = np.linspace(0.2, 0.2 + SAMPLE * STEP, SAMPLE)
    drive = mi.Sine(amplitude=0.2, omega=0.5)
    count = FREQUENCIES * (HIGH - LOW) / STEP / SAMPLE
    for _ in range(1 if quick else 3):
        begin = time.perf_counter()
        chart = mi.operating_chart(actuator, crises=0)
        seconds.append(time.perf_counter() - begin)
        begin = time.perf_counter()
        rival(PERIODS)
        units.append(time.perf_counter() - begin)
        begin = time.perf_counter()
        mi.sweep(actuator, drive, "amplitude", values, direction="both", workers=2)
        sweeps.append((time.perf_counter() - begin) * count)
    note = f"{len(chart.table)} points of the boundaries"
    yield Row("Fig. 7", "curves", "whole chart", Spread.of(seconds), "s", "<= 10", note)
    unit = f"curves / heyoka, {PERIODS:,} periods"
    yield Row("Fig. 7", "curves", unit, ratio(seconds, units), "", "<= 10")
    note = f"{FREQUENCIES} frequencies, amplitude in steps of {STEP:g}; counted up from {SAMPLE}"
    hours = Spread.of([value / 3600.0 for value in sweeps])
    yield Row("Fig. 7", "brute force", "sweeps both ways", hours, "h", note=note)
    ratios = [brute / curve for brute, curve in zip(sweeps, seconds, strict=True)]
    yield Row("Fig. 7", "both", "brute force / curves", Spread.of(ratios))
