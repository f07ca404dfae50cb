"""The impacting relief valve of the example of MPGOS, beside a loop in C++ at the same error."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import mems_impact as mi
from validation.benchmarks.matched_error import TOLERANCES
from validation.benchmarks.timing import Row, in_turn, ratio, scaled

TOPIC = "valve"
INFLOWS = (2.0, 3.0, 5.0, 6.5, 8.0)  # of periodic motions with and without impacts
INITIAL = {"x": 2.5, "v": 0.0, "p": 12.5}
SHORT, LONG = 300.0, 2000.0  # durations of the comparison of errors, and of the timed runs
ERRORS = (1e-6, 1e-8)
TARGET = ">= 1"

Floats = np.ndarray
Solver = Callable[[float, float, float], Floats]  # inflow, duration, tolerance


def flow(mode: int, t: float, y: Any, p: Any) -> tuple[float, float, float]:
    pressure = p.beta * (p.q - y.x * math.sqrt(y.p))
    return y.v, -p.kappa * y.v - (y.x + p.delta) + y.p, pressure


def opening(mode: int, t: float, y: Any, p: Any) -> float:
    return float(y.x)


def rebound(mode: int, t: float, y: Any, p: Any) -> Any:
    return mode, (0.0, -p.r * y.v, y.p)


VALVE = mi.System(
    states=tuple(INITIAL),
    flow=flow,
    parameters={"kappa": 1.25, "beta": 20.0, "delta": 10.0, "q": 9.0, "r": 0.8},
    guards=[mi.Impact("seat", opening, rebound)],
    initial=INITIAL,
    section=("v", 0.0),
)


def package(inflow: float, duration: float, tolerance: float) -> Floats:
    """Final state by this package, with maxima and minima of the position as a section."""
    options = mi.Options(method="dop853", rtol=tolerance, atol=0.01 * tolerance)
    run = mi.simulate(
        VALVE.changed(q=inflow), duration=duration, options=options, keep="statistics"
    )
    return np.array([run.final[name] for name in INITIAL])


def compiled_loop(directory: Path) -> Solver:
    """Compile ``valve.cpp``, whose maxima of the position are located as MPGOS does."""
    library = directory / "valve.so"
    source = Path(__file__).with_suffix(".cpp")
    options = ["-O3", "-march=native", "-shared", "-fPIC"]
    subprocess.run(["g++", *options, "-o", str(library), str(source)], check=True)
    integrate = ctypes.CDLL(str(library)).integrate
    state_type, real = ctypes.c_double * len(INITIAL), ctypes.c_double
    integrate.argtypes = [real, real, real, state_type, ctypes.POINTER(real)]
    integrate.restype = ctypes.c_long

    def go(inflow: float, duration: float, tolerance: float) -> Floats:
        state = state_type(*INITIAL.values())
        integrate(inflow, duration, tolerance, state, ctypes.byref(real()))
        return np.array(state[:])

    return go


def _loosest(solver: Solver, truth: list[Floats], error: float) -> float:
    """The loosest tolerance that keeps the error, and whose tighter neighbours keep it too."""
    best = TOLERANCES[-1]
    for tolerance in reversed(TOLERANCES):
        ends = [solver(inflow, SHORT, tolerance) for inflow in INFLOWS]
        if max(np.abs(end - y).max() for end, y in zip(ends, truth, strict=True)) > error:
            break
        best = tolerance
    return best


def valve(quick: bool) -> Iterator[Row]:
    """CPU seconds of five inflows on one core, at the same error of the final states."""
    if shutil.which("g++") is None:
        print("valve: no g++, so the loop in C++ is left out")
        return
    case = f"{len(INFLOWS)} inflows, t = {LONG:g}"
    with tempfile.TemporaryDirectory() as place:
        contestants: dict[str, Solver] = {"package": package, "C++": compiled_loop(Path(place))}
        truth = [contestants["C++"](inflow, SHORT, 1e-13) for inflow in INFLOWS]
        for error in ERRORS:
            jobs, names = {}, {}
            for name, solver in contestants.items():
                tolerance = _loosest(solver, truth, error)
                names[name] = f"{name}, {tolerance:.0e}"
                jobs[name] = lambda go=solver, tol=tolerance: [
                    go(inflow, LONG, tol) for inflow in INFLOWS
                ]
            seconds = in_turn(jobs, 5 if quick else 15, time.process_time)
            for name, times in seconds.items():
                yield Row(TOPIC, case, names[name], scaled(times, 1e3), "ms")
            note = f"error at t = {SHORT:g} at most {error:g}"
            faster = ratio(seconds["C++"], seconds["package"])
            yield Row(TOPIC, case, f"C++ / package, error {error:g}", faster, "", TARGET, note)
