"""Examples and tests of Assimulo with events: states at the end, which its source asserts."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import mems_impact as mi
from validation.outside.case import Case, Suite

__all__ = ["SUITE"]


def iteration() -> mi.System:
    """Three events at t = 1, each a consequence of the one before: b, a, and the slope of x."""
    falling, rising = mi.modes("falling", "rising")

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return 1.0 if mode == rising else -1.0, 0.0, 0.0

    guards = [
        mi.Guard("t", lambda mode, t, y, p: 1.0 - t, lambda mode, t, y, p: (mode, (y.x, y.a, 2.0))),
        mi.Guard(
            "b", lambda mode, t, y, p: 1.0 - y.b, lambda mode, t, y, p: (mode, (y.x, 3.0, y.b))
        ),
        mi.Guard("a", lambda mode, t, y, p: 1.0 - y.a, lambda mode, t, y, p: (rising, y)),
    ]
    return mi.System(
        states=("x", "a", "b"),
        flow=flow,
        modes=(falling, rising),
        guards=guards,
        initial={"a": -1.0},
    )


def van_der_pol() -> mi.System:
    """Van der Pol's oscillator, whose stiffness falls at four times."""
    times = (1.0, 2.0, 2.5, 3.0)

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        stiffness = 1e6
        for each in times:
            if t >= each:
                stiffness *= 0.1
        return y.v, stiffness * ((1.0 - y.x**2) * y.v - y.x)

    return mi.System(states=("x", "v"), flow=flow, switches=times, initial={"x": 2.0, "v": -0.6})


def decay() -> mi.System:
    """A decay with an event without effect."""
    guard = mi.Guard("half", lambda mode, t, y, p: y.y - 0.5)
    return mi.System(
        states=("y",), flow=lambda mode, t, y, p: (-y.y,), guards=[guard], initial={"y": 1.0}
    )


# An example by the pattern of its files.
EXAMPLES: dict[str, tuple[Callable[[], mi.System], float]] = {
    "examples/*_with_disc*.py": (iteration, 10.0),
    "examples/radau5dae_time_events.py": (van_der_pol, 8.0),
    "tests/test_solvers.py": (decay, 2.0),
}
# The number and the tolerance of ``abs(y[-1] - 2.0) < 1e-6`` and ``approx(2.0, abs = 1e-6)``.
ASSERTION = re.compile(r"\[-1\].*?(?:- |approx\()([\d.]+)(?:\) < |, abs = )([\de.-]+)")


def cases(folder: Path) -> Iterator[Case]:
    """Yield the cases: a file each."""
    for pattern, (system, duration) in EXAMPLES.items():
        for path in sorted(folder.glob(pattern)):
            asserted = ASSERTION.findall(path.read_text())
            yield Case(
                name=path.stem,
                group="events",
                values=partial(run, system, duration, len(asserted)),
                reference=[float(number) for number, _ in asserted],
                absolute=float(asserted[0][1]),
                relative=0.0,
            )


def run(system: Callable[[], mi.System], duration: float, count: int) -> list[float]:
    """Return the asserted numbers: as many of the last state, repeated for each test."""
    options = mi.Options(method="auto")
    final = mi.simulate(example := system(), duration=duration, options=options).final
    states = [getattr(final, name) for name in example.states]
    return [states[i % len(states)] for i in range(count)]


SUITE = Suite(
    repository="https://github.com/modelon-community/Assimulo",
    licence="LGPL 3",
    files="examples, tests/test_solvers.py",
    cases=cases,
)
