"""Hybrid benchmarks of the ARCH competition: specifications that reachability tools verified.

The initial box of a benchmark is sampled; a value is by how much the runs leave a specification,
or how often a run crosses a guard.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

import mems_impact as mi
from validation.outside.case import Case, Suite

__all__ = ["SUITE"]

FOLDER = "examples/ARCHcompetition"
PREFIX = "benchmark_hybrid_reach_ARCH23_"
TIME = r"tFinal = ([\d.]+);"


def gearbox() -> mi.System:
    """A sleeve of mass m that impacts on both flanks of a tooth, until it meshes with a gear.

    The state `impulse` is the sum of all impulses.
    """
    moving, meshed = mi.modes("moving", "meshed")
    m, gear, e = 3.2, 18.1, 0.9
    sine, cosine = math.sin(0.2 * math.pi), math.cos(0.2 * math.pi)

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        if mode == meshed:
            return 0.0, 0.0, 0.0, 0.0, 0.0
        return 70.0 / m, -0.08 / 0.7, y.u, y.v, 0.0

    def flank(side: float) -> mi.Guard:
        def distance(mode, t, y, p):  # type: ignore[no-untyped-def]
            return -sine / cosine * y.x - side * y.y

        def bounce(mode, t, y, p):  # type: ignore[no-untyped-def]
            speed = sine * y.u + side * cosine * y.v
            jump = (1.0 + e) * speed / (m * cosine**2 + gear * sine**2)
            u, v = y.u - gear * sine * jump, y.v - side * m * cosine * jump
            return moving, (u, v, y.x, y.y, y.impulse + m * gear * jump)

        return mi.Guard(f"flank {side:+.0f}", distance, bounce, modes=(moving,))

    def mesh(mode, t, y, p):  # type: ignore[no-untyped-def]
        return meshed, (0.0, 0.0, y.x, y.y, y.impulse + m * (y.u + y.v))

    depth = mi.Guard("meshes", lambda mode, t, y, p: -0.003 - y.x, mesh, modes=(moving,))
    return mi.System(
        states=("u", "v", "x", "y", "impulse"),
        flow=flow,
        modes=(moving, meshed),
        guards=[flank(1.0), flank(-1.0), depth],
        typical={"x": 0.01, "y": 0.01, "time": 0.1},
    )


def predators() -> mi.System:
    """Lotka and Volterra's equations, whose orbit touches a circle about the equilibrium."""

    def circle(mode, t, y, p):  # type: ignore[no-untyped-def]
        return (y.x - 1.0) ** 2 + (y.y - 1.0) ** 2 - p.radius**2

    return mi.System(
        states=("x", "y"),
        flow=lambda mode, t, y, p: (3.0 * y.x * (1.0 - y.y), y.y * (y.x - 1.0)),
        parameters={"radius": 0.161},
        guards=[
            mi.Guard("enters", circle),
            mi.Guard("leaves", lambda mode, t, y, p: -circle(mode, t, y, p)),
        ],
    )


def rendezvous() -> mi.System:
    """A spacecraft that approaches another on a circular orbit, until its thrusters fail."""
    approaching, attempting, passive = mi.modes("approaching", "attempting", "passive")
    gravity, radius, rate = 1.43496e18, 42164e3, 0.004375293492336

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        if mode == approaching:
            thrust_x = -28.8287 * y.x + 0.1005 * y.y - 1449.9754 * y.u + 0.0046 * y.v
            thrust_y = -0.087 * y.x - 33.2562 * y.y + 0.00462 * y.u - 1451.5013 * y.v
        elif mode == attempting:
            thrust_x = -288.0288 * y.x + 0.1312 * y.y - 9614.9898 * y.u
            thrust_y = -0.1312 * y.x - 288.0 * y.y - 9614.9883 * y.v
        else:
            thrust_x, thrust_y = 0.0, 0.0
        pull = gravity / ((radius + y.x) ** 2 + y.y**2) ** 1.5
        along = rate**2 * y.x + 2.0 * rate * y.v + gravity / radius**2 - pull * (radius + y.x)
        across = rate**2 * y.y - 2.0 * rate * y.u - pull * y.y
        return y.u, y.v, along + thrust_x / 500.0, across + thrust_y / 500.0

    def near(mode, t, y, p):  # type: ignore[no-untyped-def]
        return -100.0 - y.x

    return mi.System(
        states=("x", "y", "u", "v"),
        flow=flow,
        parameters={"failure": 120.0},
        modes=(approaching, attempting, passive),
        guards=[
            mi.Guard("near", near, lambda mode, t, y, p: (attempting, y), modes=(approaching,)),
            mi.Guard(
                "failure",
                lambda mode, t, y, p: p.failure - t,
                lambda mode, t, y, p: (passive, y),
                modes=(approaching, attempting),
            ),
        ],
        typical={"x": 100.0, "y": 100.0},
    )


# --- Specifications


def numbers(pattern: str, text: str) -> list[list[float]]:
    """Return the numbers of each group of a pattern, the first time that it is found."""
    found = re.search(pattern, text)
    assert found is not None
    return [[float(number) for number in group.split(";")] for group in found.groups()]


def box(low: Sequence[float], high: Sequence[float], points: int) -> list[tuple[float, ...]]:
    """Return points of a box, so many along each side."""
    axes = [np.linspace(a, b, points if b > a else 1) for a, b in zip(low, high, strict=True)]
    return list(product(*(axis.tolist() for axis in axes)))


def meshing(text: str) -> list[float]:
    """Return how far the impulse exceeds its limit, and meshing the end of the run."""
    ((limit,),), ((end,),) = numbers(r"supremum\(temp\) >= (\d+)", text), numbers(TIME, text)
    low, high = numbers(r"interval\(\[(.*?)\],\[(.*?)\]\)", text)
    system, excess = gearbox(), [0.0, 0.0]
    for point in box(low, high, 5):
        initial = dict(zip(system.states, point, strict=True))
        run = mi.simulate(system, duration=2.0 * end, initial=initial)
        time = run.events.query("event == 'meshes'")["t"].iloc[0]
        excess = [max(excess[0], run.final.impulse - limit), max(excess[1], time - end)]
    return excess


def crossings(text: str) -> list[int]:
    """Return the numbers of crossings of the circle that occur."""
    ((end,),), ((width,),) = numbers(TIME, text), numbers(r"e = (\S+);", text)
    system = predators()
    runs = [
        mi.simulate(system, duration=end, initial={"x": x, "y": 1.0})
        for x in np.linspace(1.3 - width, 1.3 + width, 25).tolist()
    ]
    return sorted({len(run.events) for run in runs})


def docking(text: str) -> list[float]:
    """Return how far speed, line of sight and distance from the station leave their limits."""
    ((end,),) = numbers(TIME, text)
    centre, size = numbers(r"zonotope\(\[\[(.*?);0\],diag\(\[(.*?);0\]\)\]\)", text)
    (limits,) = numbers(r"d = \[(.*?)\];", text)
    low, high = np.subtract(centre, size).tolist(), np.add(centre, size).tolist()
    system, excess = rendezvous(), [0.0, 0.0, 0.0]
    for *point, failure in box([*low, 120.0], [*high, 150.0], 2):
        initial = dict(zip(system.states, point, strict=True))
        run = mi.simulate(system.changed(failure=failure), duration=end, initial=initial)
        samples = run.samples(10)
        attempt = samples[samples["mode"] == "attempting"]
        after = samples[samples["mode"] == "passive"]
        u, v = attempt["u"].abs(), attempt["v"].abs()
        speed = np.maximum(np.maximum(u, v) - limits[0], u + v - limits[-1]).max()
        sight = (attempt["y"].abs() + math.tan(math.pi / 9.0) * attempt["x"]).max()
        gap = 1.0 - np.maximum(after["x"].abs(), after["y"].abs()).min()
        excess = np.maximum(excess, [speed, sight, gap]).tolist()
    return excess


# The values of a benchmark, and the reference.
BENCHMARKS: dict[str, tuple[Callable[[str], Sequence[float]], list[float]]] = {
    "linear/gearbox_GRBX01": (meshing, [0.0, 0.0]),
    "linear/gearbox_GRBX02": (meshing, [0.0, 0.0]),
    "nonlinear/lotkaVolterra": (crossings, [2.0, 4.0]),
    "nonlinear/spacecraft": (docking, [0.0, 0.0, 0.0]),
}


def cases(folder: Path) -> Iterator[Case]:
    """Yield the cases: a benchmark each."""
    for name, (values, reference) in BENCHMARKS.items():
        path = folder / FOLDER / name.replace("/", f"/{PREFIX}")
        yield Case(
            name=name,
            group="specifications",
            values=partial(values, path.with_suffix(".m").read_text()),
            reference=reference,
            absolute=0.0,
            relative=0.0,
        )


SUITE = Suite(
    repository="https://github.com/TUMcps/CORA",
    licence="GPL 3",
    files=FOLDER,
    cases=cases,
)
