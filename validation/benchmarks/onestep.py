"""The one-step method against heyoka at the same error, CVODE, and SciPy's DOP853."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from validation.benchmarks.contestants import PERIODIC, WATCHFUL, heyoka, package, scipy_ivp
from validation.benchmarks.matched_error import ENDS, TOLERANCES
from validation.benchmarks.timing import Row, Spread, in_turn, ratio, scaled

TOPIC = "one-step method"
LENGTH, SHORT = 2000, 5  # forcing periods, and those of SciPy
ERRORS = {2e-9: "<= 0.85", 6e-12: "<= 1"}  # of the step, and the target beside heyoka

Go = Callable[[float], np.ndarray]


def dop853(rtol: float) -> Go:
    go = package(PERIODIC, rtol=rtol, method="dop853")
    return lambda periods: go(periods).final.y


def adams(rtol: float) -> Go:
    go = package(PERIODIC, rtol=rtol)
    return lambda periods: go(periods).final.y


def step_error(go: Go, travelled: list[float]) -> float:
    """The largest relative error of the distance travelled over 96 to 100 forcing periods."""
    return max(abs(go(n)[0] / x - 1.0) for n, x in zip(ENDS, travelled, strict=True))


def loosest(solver: Callable[[float], Go], travelled: list[float], error: float) -> float:
    """The loosest tolerance that keeps the error, and whose tighter neighbours keep it too."""
    best = TOLERANCES[-1]
    for tolerance in reversed(TOLERANCES):
        if step_error(solver(tolerance), travelled) > error:
            break
        best = tolerance
    return best


def one_step(quick: bool) -> Iterator[Row]:
    exact = heyoka(PERIODIC, 0.0)
    travelled = [float(exact(n)[0]) for n in ENDS]
    jobs: dict[str, Go] = {"Adams, default": adams(1e-9), "dop853, default": dop853(1e-9)}
    pairs = {}
    for error in ERRORS:
        names = []
        for name, solver in {"dop853": dop853, "heyoka": lambda tol: heyoka(PERIODIC, tol)}.items():
            tolerance = loosest(solver, travelled, error)
            names.append(f"{name}, {tolerance:.0e}")
            jobs[names[-1]] = solver(tolerance)
        pairs[error] = names
    scipy = scipy_ivp(PERIODIC, "DOP853", 1e-9, WATCHFUL)
    runs: dict[str, Callable[[], object]] = {
        name: (lambda go=go: go(LENGTH)) for name, go in jobs.items()
    }
    seconds = in_turn({**runs, "SciPy": lambda: scipy(SHORT)}, 5 if quick else 15)
    for name, go in jobs.items():
        error = step_error(go, travelled)
        yield Row(TOPIC, PERIODIC.name, name, scaled(seconds[name], 1e6 / LENGTH), "us")
        yield Row(TOPIC, PERIODIC.name, f"{name}: error of the step", Spread.of([error]))
    for error, (ours, rival) in pairs.items():
        value = ratio(seconds[ours], seconds[rival])
        note = f"error of the step at most {error:g}"
        yield Row(TOPIC, PERIODIC.name, f"{ours} / {rival}", value, "", ERRORS[error], note)
    fast = seconds["dop853, default"]
    yield Row(
        TOPIC, PERIODIC.name, "Adams / dop853", ratio(seconds["Adams, default"], fast), "", ">= 5"
    )
    value = ratio(seconds["SciPy"], fast, LENGTH / SHORT)
    yield Row(TOPIC, PERIODIC.name, "SciPy DOP853 / dop853", value, "", ">= 150", "same events")
