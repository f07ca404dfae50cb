"""Callback tests of SciML: each compares with the number that its test asserts, or a closed form.

A callback on both crossings of zero is two guards. Integration backwards is the reversed equation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mems_impact as mi
from validation.outside.case import Case, Suite

__all__ = ["SUITE"]

EVENTS = "test/Integrators_I/ode_event_tests.jl"
DETECTION = "test/Integrators_I/event_detection_tests.jl"
REPEATS = "test/Integrators_I/event_repeat_tests.jl"
BACKWARDS = "test/Integrators_II/rev_events_tests.jl"
GRADIENTS = "test/AD/autodiff_events.jl"
CALLBACKS = "lib/DiffEqBase/test/downstream/callback_detection.jl"
MERGING = "lib/DiffEqBase/test/downstream/callback_merging.jl"
COMMUNITY = "lib/DiffEqBase/test/downstream/community_callback_tests.jl"
APPROXIMATE = 1.5e-8  # relative, of Julia's isapprox


@dataclass(frozen=True)
class Test:
    """A test: its file, its values, the reference, and tolerances."""

    file: str
    values: Callable[[], Any]
    reference: Any
    absolute: float
    relative: float


TESTS: list[Test] = []


def asserts(
    file: str, reference: Any, absolute: float = 0.0, relative: float = APPROXIMATE
) -> Callable[[Callable[[], Any]], Callable[[], Any]]:
    """Enter a function that returns the values of a test."""

    def enter(values: Callable[[], Any]) -> Callable[[], Any]:
        TESTS.append(Test(file, values, reference, absolute, relative))
        return values

    return enter


def crossings(name: str, value: Callable[..., float], **changes: Any) -> list[mi.Guard]:
    """Return guards that record the crossings of zero in both directions."""
    falls = mi.Guard(f"{name} falls", lambda mode, t, y, p: value(t, y), **changes)
    rises = mi.Guard(f"{name} rises", lambda mode, t, y, p: -value(t, y), **changes)
    return [falls, rises]


def times(run: mi.Run, *names: str) -> list[float]:
    """Return the times of the events of these names, all by default."""
    events = run.events
    return list(events.loc[events["event"].isin(names), "t"] if names else events["t"])


def steady(mode, t, y, p):  # type: ignore[no-untyped-def]
    return (1.0,)


def free(mode, t, y, p):  # type: ignore[no-untyped-def]
    return y.v, -p.g


def ball(g: float = 9.81, e: float = 1.0, x: float = 50.0) -> mi.System:
    return mi.System(
        states=("x", "v"),
        flow=free,
        parameters={"g": g, "e": e},
        initial={"x": x},
        parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution="e")],
    )


# --- Callbacks that change the state

JUMP = 2.0 * math.exp(-7.05)


@asserts(EVENTS, 1.5 * math.exp(-10.0) + (math.sin(10.0) - math.cos(10.0)) / 2.0 + JUMP, 0.0, 1e-6)
def jump_at_a_time() -> float:
    guard = mi.Guard(
        "2.95", lambda mode, t, y, p: 2.95 - t, lambda mode, t, y, p: (mode, (y.u + 2.0,))
    )
    flow = lambda mode, t, y, p: (math.sin(t) - y.u,)  # noqa: E731
    system = mi.System(states=("u",), flow=flow, initial={"u": 1.0}, guards=[guard])
    return mi.simulate(system, duration=10.0).final.u


@asserts(
    EVENTS,
    0.5 * math.exp(10.0) + (math.sin(10.0) + math.cos(10.0)) / 2.0 + 2.0 * math.exp(7.05),
    0.0,
    1e-6,
)
def jump_backwards() -> float:
    guard = mi.Guard(
        "2.95", lambda mode, t, y, p: 2.95 - t, lambda mode, t, y, p: (mode, (y.u + 2.0,))
    )
    flow = lambda mode, t, y, p: (y.u - math.sin(t),)  # noqa: E731
    system = mi.System(states=("u",), flow=flow, initial={"u": 1.0}, guards=[guard])
    return mi.simulate(system, duration=10.0).final.u


@asserts(EVENTS, [20.0 - 19.0 / math.e, 1.0 / math.e])
def discrete_callback() -> list[float]:
    """Both states are set to 1 at two times."""
    system = mi.System(
        states=("u", "v"),
        flow=lambda mode, t, y, p: (10.0 - 0.5 * y.u, -0.5 * y.v),
        initial={"u": 10.0, "v": 10.0},
        switches=(5.0, 8.0),
        switch_transition=lambda mode, t, y, p: (mode, (1.0, 1.0)),
    )
    final = mi.simulate(system, duration=10.0).final
    return [final.u, final.v]


@asserts(EVENTS, [50.0 - 4.5 * 9.81, -3.0 * 9.81])
def before_the_bounce() -> list[float]:
    final = mi.simulate(ball(), duration=3.0).final
    return [final.x, final.v]


@asserts(EVENTS, math.sqrt(100.0 / 9.81))
def terminated() -> float:
    system = mi.System(states=("x", "v"), flow=free, parameters={"g": 9.81}, initial={"x": 50.0})
    return mi.simulate(system, until=lambda mode, t, y, p: y.x).end


@asserts(EVENTS, [3.0 * math.sqrt(100.0 / 9.81), 0.0], 1.3e-10)
def terminated_at_the_second_bounce() -> list[float]:
    run = mi.simulate(ball(), duration=15.0)
    impacts = run.events[run.events["t"] >= 3.5]
    return [impacts["t"].iloc[0], impacts["x"].iloc[0]]


@asserts(EVENTS, [4.0, 1.0])
def terminated_at_a_time() -> list[float]:
    run = mi.simulate(ball(), until=lambda mode, t, y, p: 4.0 - t)
    return [run.end, 0.0 < run.final.x < 100.0]


@asserts(EVENTS, [100.0])
def event_at_a_step() -> list[float]:
    system = mi.System(
        states=("u",),
        flow=lambda mode, t, y, p: (1.00001 * y.u,),
        initial={"u": 1.0},
        guards=[mi.Guard("100", lambda mode, t, y, p: 100.0 - t)],
    )
    return times(mi.simulate(system, duration=200.0))


@asserts(EVENTS, [0.5])
def complex_state() -> list[float]:
    system = mi.System(
        states=("re", "im"),
        flow=lambda mode, t, y, p: (y.im, -y.re),
        initial={"re": 1.0},
        guards=[mi.Guard("0.5", lambda mode, t, y, p: 0.5 - t)],
    )
    return times(mi.simulate(system, duration=1.0))


@asserts(EVENTS, [0.0, 0.0], 0.02)
def valve() -> list[float]:
    """Move a valve with friction between two stops by an oscillating pressure, 3222."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        pressure = 6895.0 * (18.0 + 4.0 * math.sin(500.0 * math.pi * t))
        force = 7.373657906574696e-5 * pressure - 1488.578099595049 * y.x - 8.54503372291542
        return y.v, force / 0.0003361185937456267

    system = mi.System(
        states=("x", "v"),
        flow=flow,
        masses={"v": 0.0003361185937456267},
        time_scale=1e-3,
        parts=[
            mi.Friction("seal", "v", mu=1.0),
            mi.Stopper("stops", "x", "v", lower=0.0, upper=0.001016, restitution=0.3),
        ],
    )
    samples = mi.simulate(system, duration=0.0025).samples(1000)
    return list(samples["v"].iloc[[1280, 1350]])


@asserts(EVENTS, [math.pi / 2.0, math.pi / 6.0, 5.0 * math.pi / 6.0, math.pi / 2.0], 1e-2)
def directions() -> list[float]:
    """Two cosines of one zero, 3594."""
    run = mi.simulate(cosines(), duration=3.1)
    return times(run, "1 falls") + times(run, "2 falls") + times(run, "2 rises")


@asserts(EVENTS, [1.0, 10.0], 1e-10)
def stuck_at_zero() -> list[float]:
    """Hold a state at the zero of its guard, 3627."""
    rising, stuck = mi.modes("rising", "stuck")
    system = mi.System(
        states=("u", "v"),
        flow=lambda mode, t, y, p: (0.5, 1.0 if mode == rising else 0.0),
        modes=(rising, stuck),
        guards=[
            *crossings("1", lambda t, y: y.u - 5.0),
            mi.Guard("2", lambda mode, t, y, p: 1.0 - y.v, lambda mode, t, y, p: (stuck, y)),
        ],
    )
    return times(mi.simulate(system, duration=20.0))


# --- Detection


def cosines(order: int = 1) -> mi.System:
    guards = [*crossings("1", lambda t, y: y.a), *crossings("2", lambda t, y: y.b)]
    return mi.System(
        states=("a", "b"),
        flow=lambda mode, t, y, p: (-math.sin(t), -3.0 * math.sin(3.0 * t)),
        initial={"a": 1.0, "b": 1.0},
        guards=guards[::order],
    )


THIRDS = [math.pi * k / 6.0 for k in (1, 3, 5, 7, 9, 11)]


@asserts(CALLBACKS, 2 * [*THIRDS, THIRDS[1], THIRDS[4]])
def order_of_callbacks() -> list[float]:
    """All zeros of two cosines, in any order of the guards, 1268."""
    found = []
    for order in (1, -1):
        run = mi.simulate(cosines(order), duration=2.0 * math.pi)
        found += sorted(times(run, "2 falls", "2 rises")) + times(run, "1 falls", "1 rises")
    return found


@asserts(CALLBACKS, [1.0, 1.0 + 1e-8, 1.0 + 2e-8, 1.0 + 2e-7], 1e-15, 0.0)
def successive_callbacks() -> list[float]:
    """Zeros at a distance of 1e-8 within a step, 1231."""
    guards = [
        guard
        for i, zero in enumerate((1.0, 1.0 + 1e-8, 1.0 + 2e-8, 1.0 + 2e-7))
        for guard in crossings(f"{i}", lambda t, y, zero=zero: t - zero)
    ]
    system = mi.System(states=("u",), flow=steady, guards=guards)
    return times(mi.simulate(system, duration=2.0))


def cubic(t):  # type: ignore[no-untyped-def]
    return (t - 0.1) * (t - 0.4) * (t - 0.8)


@asserts(CALLBACKS, [0.1, 0.2, 0.4, 0.5, 0.8, 0.9])
def roots_in_one_step() -> list[float]:
    guards = [*crossings("1", lambda t, y: cubic(t)), *crossings("2", lambda t, y: cubic(t - 0.1))]
    return times(mi.simulate(mi.System(states=("u",), flow=steady, guards=guards), duration=1.0))


@asserts(CALLBACKS, [math.sqrt(x) for x in (0.1, 0.2, 0.4, 0.5, 0.8, 0.9)])
def quadratic_roots() -> list[float]:
    guards = [
        *crossings("1", lambda t, y: cubic(t * t)),
        *crossings("2", lambda t, y: cubic(t * t - 0.1)),
    ]
    return times(mi.simulate(mi.System(states=("u",), flow=steady, guards=guards), duration=1.0))


@asserts(MERGING, [0.3, 0.7])
def two_callbacks() -> list[float]:
    """Two times of a run of Lorenz's system."""
    system = mi.System(
        states=("x", "y", "z"),
        flow=lambda mode, t, y, p: (
            10.0 * (y.y - y.x),
            y.x * (28.0 - y.z) - y.y,
            y.x * y.y - 8.0 / 3.0 * y.z,
        ),
        initial={"x": 1.0},
        guards=[*crossings("1", lambda t, y: t - 0.3), *crossings("2", lambda t, y: t - 0.7)],
    )
    return times(mi.simulate(system, duration=1.0))


def section(duration: float) -> int:
    """Return the number of upward crossings of a chaotic section."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        square = y.q0**2 + y.q2**2
        return (
            -y.q0 - 1.65 / math.sqrt(2.0) * (y.q2**2 - y.q0**2) - 0.4 * y.q0 * square,
            -y.q2 * (1.0 + 1.65 * math.sqrt(2.0) * y.q0 + 0.4 * square),
            y.p0,
            y.p2,
        )

    system = mi.System(
        states=("p0", "p2", "q0", "q2"),
        flow=flow,
        initial={"p0": 7.1989885061904335, "p2": -0.165912283356219, "q2": -3.63534900748947},
        guards=[mi.Guard("q0", lambda mode, t, y, p: -y.q0)],
    )
    options = mi.Options(method="dop853", rtol=1e-12, atol=1e-14)
    return len(mi.simulate(system, duration=duration, options=options).events)


@asserts(DETECTION, [1.0, 1.0])
def chaotic_section() -> list[float]:
    return [section(300.0) > 100, section(5000.0) > 1500]


@asserts(DETECTION, 490.0, 0.0, 1e-6)
def ten_thousand_seconds() -> float:
    """Return the energy of an elastic ball after 1565 bounces."""
    final = mi.simulate(ball(g=9.8), duration=10000.0).final
    return 9.8 * final.x + 0.5 * final.v**2


@asserts(DETECTION, [3.0, 2.0])
def ball_between_walls() -> list[float]:
    system = mi.System(
        states=("x", "v", "z", "w"),
        flow=lambda mode, t, y, p: (y.v, -9.8, y.w, 0.0),
        initial={"x": 50.0, "w": 2.0},
        parts=[
            mi.Stopper("floor", "x", "v", lower=0.0, restitution=0.9),
            mi.Stopper("walls", "z", "w", lower=0.0, upper=10.0, restitution=0.9),
        ],
    )
    run = mi.simulate(system, duration=15.0)
    return [len(times(run, "floor")), len(times(run, "walls lower", "walls upper"))]


@asserts(DETECTION, 0.0)
def constant_condition() -> int:
    """Count the zeros of a constant, 1273."""
    system = mi.System(states=("u",), flow=steady, guards=crossings("1", lambda t, y: 1.0))
    return len(mi.simulate(system, duration=1.0).events)


EPS = 2.0**-52


@asserts(REPEATS, 5 * [1.0])
def events_at_the_resolution() -> list[int]:
    """Five zeros ten units of rounding apart: each once."""
    zeros = (50, 60, 70, 80, 90)
    guards = [
        guard
        for k in zeros
        for guard in crossings(f"{k}", lambda t, y, k=k: y.u - math.exp(k * EPS))
    ]
    flow = lambda mode, t, y, p: (y.u,)  # noqa: E731
    scale, initial = 100.0 * EPS, {"u": 1.0}
    system = mi.System(states=("u",), flow=flow, initial=initial, guards=guards, time_scale=scale)
    run = mi.simulate(system, duration=scale)
    return [len(times(run, f"{k} rises", f"{k} falls")) for k in zeros]


@asserts(BACKWARDS, [math.e, math.log(5.0 / math.e)])
def backwards() -> list[float]:
    flow = lambda mode, t, y, p: (-y.u,)  # noqa: E731
    system = mi.System(states=("u",), flow=flow, initial={"u": 5.0})
    run = mi.simulate(system, until=lambda mode, t, y, p: y.u - math.e)
    return [run.final.u, run.end]


@asserts(COMMUNITY, math.pi / 2.0, 1e-4)
def pulled() -> float:
    """Return when a mass on a spring has no speed, 1528."""
    flow = lambda mode, t, y, p: (0.0, y.v, y.a - y.x)  # noqa: E731
    system = mi.System(states=("a", "x", "v"), flow=flow, initial={"v": 1.0})
    return mi.simulate(system, until=lambda mode, t, y, p: y.v).end


SPEED = math.sqrt(2.0 * 9.8)


@asserts(GRADIENTS, [[1.8 / SPEED - 0.5, SPEED - 2.0], [1.8 / SPEED - 1.0, SPEED]])
def derivatives() -> Any:
    """Of the final state by acceleration and restitution, through a bounce."""
    rates = mi.simulate(ball(9.8, 0.8, 1.0), duration=1.0).derivatives(["g", "e"])
    return rates.final.loc[["x", "v"], ["g", "e"]]


def cases(folder: Path) -> Iterator[Case]:
    """Yield the tests whose files are in the folder."""
    for test in TESTS:
        if (folder / test.file).exists():
            yield Case(
                name=test.values.__name__,
                group=Path(test.file).stem,
                values=test.values,
                reference=test.reference,
                absolute=test.absolute,
                relative=test.relative,
            )


SUITE = Suite(
    repository="https://github.com/SciML/OrdinaryDiffEq.jl",
    licence="MIT",
    files="test, lib/DiffEqBase/test",
    cases=cases,
)
