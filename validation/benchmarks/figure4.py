"""The sweep of Fig. 4: 401 amplitudes, up and down, 300 + 60 forcing periods each."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

import mems_impact as mi
from validation.benchmarks.timing import Row, Spread


def figure4(quick: bool) -> Iterator[Row]:
    """Two chains on two threads, with the table that a user gets."""
    values = np.linspace(0.16, 0.24, 21 if quick else 401)
    actuator = mi.load_actuator("zhao2004")
    drive = mi.Sine(amplitude=0.16, omega=0.5)
    mi.sweep(actuator, drive, "amplitude", values[:2], transient=2, periods=1, direction="both")
    seconds = []
    for _ in range(1 if quick else 3):
        begin = time.perf_counter()
        sweep = mi.sweep(actuator, drive, "amplitude", values, direction="both", workers=2)
        seconds.append((time.perf_counter() - begin) * 401 / len(values))
    note = f"{len(sweep.table)} rows; default tolerances" + ("; scaled up from 21" if quick else "")
    yield Row(
        "Fig. 4 sweep",
        "omega 0.5",
        "401 amplitudes, both ways",
        Spread.of(seconds),
        "s",
        "<= 15",
        note,
    )
