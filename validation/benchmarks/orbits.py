"""Orbits, branches and the curves of Fig. 7 by the one-step method, beside CVODE."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

import mems_impact as mi
from mems_impact.analysis.orbit import ORBIT_OPTIONS
from validation.benchmarks.timing import Row, Spread, in_turn, ratio

TOPIC = "orbits"
METHODS = ("dop853", "adams")
POINTS = 100  # of the branch
AGREE = 1e-9  # of special points


def orbits(quick: bool) -> Iterator[Row]:
    actuator = mi.load_actuator("zhao2004")
    drive = mi.Sine(amplitude=0.24, omega=0.5)
    start = mi.simulate(actuator, drive, 300).final
    steps = mi.StepControl(initial_step=1e-3, max_step=2.5e-3, max_points=POINTS)
    options = {method: replace(ORBIT_OPTIONS, method=method) for method in METHODS}
    charts: dict[str, mi.OperatingChart] = {}

    def orbit(method: str) -> mi.Orbit:
        return mi.find_orbit(actuator, drive, guess=start, options=options[method])

    found = {method: orbit(method) for method in METHODS}

    def branch(method: str) -> mi.Branch:
        return mi.continue_solution(found[method], "amplitude", 0.3, steps=steps)

    def curves(method: str) -> None:
        charts[method] = mi.operating_chart(actuator, crises=0, options=options[method])

    jobs: dict[str, tuple[Callable[[str], object], int]] = {
        "find_orbit, from a state near it": (orbit, 15),
        f"branch of {len(branch('dop853'))} orbits": (branch, 5),
        "all curves of Fig. 7": (curves, 3),
    }
    for name, (job, rounds) in jobs.items():
        runs = {method: (lambda method=method, job=job: job(method)) for method in METHODS}
        times = in_turn(runs, 1 if quick else rounds)
        for method in METHODS:
            yield Row(TOPIC, name, method, Spread.of(times[method]), "s")
        yield Row(TOPIC, name, "adams / dop853", ratio(times["adams"], times["dop853"]))
    numbers = [
        charts[method].special_table[["omega", "amplitude"]].to_numpy() for method in METHODS
    ]
    apart = float(np.abs(numbers[0] - numbers[1]).max())
    target = f"<= {AGREE:g}"
    yield Row(TOPIC, "special points of Fig. 7", "apart", Spread.of([apart]), target=target)
