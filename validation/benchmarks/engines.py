"""The compiled engine against CVODE with Python callbacks and against SciPy, same tolerance.

Each rival comes twice: as one writes it first, which watches impacts and the ends of slips alone,
and with the "same events" as this package, which misses neither grazes nor break-aways.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from validation.benchmarks.contestants import (
    CASES,
    LEAN,
    WATCHFUL,
    Case,
    package,
    scikit_sundae,
    scipy_ivp,
)
from validation.benchmarks.timing import Row, Spread, in_turn, ratio, scaled

RTOL = 1e-9
LONG = 1000  # forcing periods of the compiled engine
LOOP, SAME = "scikit-sundae, hand-written loop", "same events"


def _compare(
    topic: str,
    case: Case,
    rivals: dict[str, tuple[Callable[[float], object], float]],
    rounds: int,
) -> tuple[list[Row], dict[str, Spread]]:
    """Time each rival, over its own number of periods, in turn with the compiled engine."""
    ours = package(case, rtol=RTOL)
    jobs: dict[str, Callable[[], object]] = {"compiled": lambda: ours(LONG)}
    for name, (go, periods) in rivals.items():
        jobs[name] = lambda go=go, periods=periods: go(periods)  # type: ignore[misc]
    seconds = in_turn(jobs, rounds)
    cost = [Row(topic, case.name, "compiled engine", scaled(seconds["compiled"], 1e3 / LONG), "ms")]
    ratios = {}
    for name, (_, periods) in rivals.items():
        cost.append(Row(topic, case.name, name, scaled(seconds[name], 1e3 / periods), "ms"))
        ratios[name] = ratio(seconds[name], seconds["compiled"], LONG / periods)
    return cost, ratios


def against_python_callbacks(quick: bool) -> Iterator[Row]:
    """scikit-sundae through its Python API: this package's own fallback, and a user's loop."""
    topic = "Python callbacks"
    for case in CASES:
        rivals = {
            LOOP: (scikit_sundae(case, RTOL), 10 if quick else 40),
            f"{LOOP}, {SAME}": (scikit_sundae(case, RTOL, WATCHFUL), 10 if quick else 40),
            "interpreted engine": (package(case, "interpreted", rtol=RTOL), 3 if quick else 10),
        }
        cost, ratios = _compare(topic, case, rivals, 3 if quick else 7)
        yield from cost
        for name, value in ratios.items():
            what = f"{name} / compiled"
            yield Row(topic, case.name, what, value, "", ">= 25", f"rtol {RTOL:g}, per period")


def against_scipy(quick: bool) -> Iterator[Row]:
    """`solve_ivp` with terminal events; the target is against DOP853, the faster method."""
    topic = "SciPy solve_ivp"
    for case in CASES:
        rivals = {
            name: (scipy_ivp(case, name.split(",")[0], RTOL, watched), 5 if quick else 20)
            for method in ("DOP853", "LSODA")
            for name, watched in ((method, LEAN), (f"{method}, {SAME}", WATCHFUL))
        }
        cost, ratios = _compare(topic, case, rivals, 3 if quick else 7)
        yield from cost
        for name, value in ratios.items():
            target = ">= 50" if name.startswith("DOP853") else ""
            yield Row(topic, case.name, f"{name} / compiled", value, "", target, f"rtol {RTOL:g}")
