"""Reference files of Siconos: impacts, friction, relays, diodes, sampled control.

Signals are compared at the times of the reference that lie on its grid, relative to their ranges.
Event-driven references have the error of LSODAR. A time-stepping reference does not locate events:
each may be late by a step, and so may all that follows.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import mems_impact as mi
from validation.outside.case import Case, Refused, Suite

__all__ = ["SUITE"]

FOLDER = "examples"


@dataclass(frozen=True)
class Example:
    """An example: its system; columns of its signals; samples per time scale.

    Each event delays a time-stepping reference by `late` steps; `tolerance` is of the range of a
    signal.
    """

    system: Callable[[], mi.System]
    signals: Mapping[str, int]
    rate: int
    late: int = 3  # one step until the event, two by the error of the speed
    tolerance: float = 2.5e-2


# --- Balls and oscillators with stops


def fall(mode, t, y, p):  # type: ignore[no-untyped-def]
    return y.v, -p.g


def ball(g: float = 9.81, e: float = 0.9, **changes: Any) -> mi.System:
    stops = {"lower": 0.0, "restitution": e, "upper": changes.pop("upper", None)}
    return mi.System(
        states=("x", "v"),
        flow=fall,
        parameters={"g": g},
        initial={"x": 1.0, **changes},
        parts=[mi.Stopper("floor", "x", "v", **stops)],
    )


def tilted() -> mi.System:
    """A ball on a slope x + 0.1 y = 0, in distance and position along the slope."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.v, -10.0, y.w, 1.0

    return mi.System(
        states=("x", "v", "z", "w"),
        flow=flow,
        initial={"x": 1.0, "z": -0.1},
        parts=[mi.Stopper("slope", "x", "v", lower=0.0, restitution=0.9)],
    )


def moving_plane() -> mi.System:
    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.v, -9.81, y.w, -0.5 * math.pi * math.sin(0.5 * math.pi * t)

    return mi.System(
        states=("x", "v", "z", "w"),
        flow=flow,
        initial={"x": 1.0, "w": 3.0},
        parts=[mi.Stopper("plane", "x", "v", lower=0.0, restitution=0.9, against=("z", "w"))],
    )


def compliant_floor() -> mi.System:
    """A ball on a spring, under a roof that it starts above."""

    def roof(mode, t, y, p):  # type: ignore[no-untyped-def]
        return 0.7 - y.x

    def bounce(mode, t, y, p):  # type: ignore[no-untyped-def]
        return mode, (y.x, -y.v)

    return mi.System(
        states=("x", "v"),
        flow=fall,
        parameters={"g": 9.81},
        initial={"x": 1.0},
        guards=[mi.Guard("roof", roof, bounce)],
        parts=[mi.Stopper("floor", "x", "v", lower=0.1, law=lambda depth, rate, p: 100.0 * depth)],
    )


def oscillator() -> mi.System:
    """Two springs, one of them with a stop."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.v, -1e5 * y.x - 9.81, y.w, -1e5 * y.z

    return mi.System(
        states=("x", "v", "z", "w"),
        flow=flow,
        initial={"x": 1.0, "z": 0.001},
        time_scale=0.02,
        parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution=0.9)],
    )


def follower(x: float) -> mi.System:
    """A spring and a stop; the force of the cam is zero in the reference."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.v, -1430.8 / 1.221 * y.x

    return mi.System(
        states=("x", "v"),
        flow=flow,
        initial={"x": x, "v": x},
        parts=[mi.Stopper("cam", "x", "v", lower=0.0, restitution=0.8)],
    )


def column() -> mi.System:
    """Ten beads on each other, above the floor."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        a = -9.81
        return (
            y.v0, y.v1, y.v2, y.v3, y.v4, y.v5, y.v6, y.v7, y.v8, y.v9,
            a, a, a, a, a, a, a, a, a, a,
        )  # fmt: skip

    beads = [(f"x{i}", f"v{i}") for i in range(10)]
    pairs = enumerate(itertools.pairwise(beads))
    gaps = {"lower": 0.01, "restitution": 1.0}
    return mi.System(
        states=(*(x for x, _ in beads), *(v for _, v in beads)),
        flow=flow,
        masses={v: 1.0 for _, v in beads},
        initial={x: 0.055 + 0.01 * i for i, (x, _) in enumerate(beads)},
        parts=[
            mi.Stopper("floor", "x0", "v0", lower=0.005, restitution=1.0),
            *(mi.Stopper(f"gap{i}", *bead, against=below, **gaps) for i, (below, bead) in pairs),
        ],
    )


# --- Pendulums and rigid bodies


def pendulum() -> mi.System:
    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.w, -9.81 * math.sin(y.a)

    return mi.System(states=("a", "w"), flow=flow, initial={"a": math.pi / 3.0})


def slider() -> mi.System:
    """A pendulum on a slider between two walls, each of mass 1 and the length 1."""
    free, left, right = mi.modes("free", "left", "right")

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        sine, cosine = math.sin(y.a), math.cos(y.a)
        push = y.w**2 * sine + 9.81 * sine * cosine  # of the pendulum on a slider at rest
        a = push / (2.0 - cosine**2) if mode == free else 0.0
        return y.v, a, y.w, -9.81 * sine - cosine * a

    def wall(side):  # type: ignore[no-untyped-def]
        def gap(mode, t, y, p):  # type: ignore[no-untyped-def]
            return 0.1125 - side * (y.x - 0.125)

        def strike(mode, t, y, p):  # type: ignore[no-untyped-def]
            return free, (y.x, -0.5 * y.v, y.a, y.w + 1.5 * y.v * math.cos(y.a))

        def rest(mode, t, y, p):  # type: ignore[no-untyped-def]
            held = (0.125 + side * 0.1125, 0.0, y.a, y.w + y.v * math.cos(y.a))
            return (right if side > 0.0 else left), held

        return mi.Impact(f"wall {side:+.0f}", gap, strike, rest=rest, modes=(free,))

    def pressed(mode, t, y, p):  # type: ignore[no-untyped-def]
        push = math.sin(y.a) * (y.w**2 + 9.81 * math.cos(y.a))
        return push if mode == right else -push

    def leave(mode, t, y, p):  # type: ignore[no-untyped-def]
        return free, y

    off = mi.Guard("leaves", pressed, leave, modes=(left, right), condition=True)
    return mi.System(
        states=("x", "v", "a", "w"),
        flow=flow,
        initial={"x": 0.1, "v": 2.0, "a": 0.1},
        guards=[wall(-1.0), wall(1.0), off],
    )


def block() -> mi.System:
    """A falling block whose two corners strike the floor."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.v, -9.81, y.w, 0.0

    def corner(side):  # type: ignore[no-untyped-def]
        def gap(mode, t, y, p):  # type: ignore[no-untyped-def]
            return y.z + side * 0.1 * math.sin(y.a) - 0.05 * math.cos(y.a)

        def strike(mode, t, y, p):  # type: ignore[no-untyped-def]
            arm = side * 0.1 * math.cos(y.a) + 0.05 * math.sin(y.a)
            impulse = -1.9 * (y.v + arm * y.w) / (1.0 + arm**2 / p.inertia)
            return mode, (y.z, y.v + impulse, y.a, y.w + arm * impulse / p.inertia)

        return mi.Impact(f"corner {side:+.0f}", gap, strike)

    a = math.pi / 3.0
    height = 0.5 * math.sin(a) + 0.25 * math.cos(a)
    return mi.System(
        states=("z", "v", "a", "w"),
        flow=flow,
        parameters={"inertia": 1.25 / 12.0},
        initial={"z": height, "a": a},
        guards=[corner(-1.0), corner(1.0)],
    )


# --- Friction and relays


def friction() -> mi.System:
    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.v, -y.x

    parts = [mi.Friction("ground", "v", mu=1.0)]
    return mi.System(states=("x", "v"), flow=flow, initial={"x": 12.0, "v": 6.0}, parts=parts)


def relay() -> mi.System:
    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.y, y.z, -3.0 * y.y - 2.0 * y.z - mode.relay

    return mi.System(
        states=("x", "y", "z"),
        flow=flow,
        initial={"y": 1.5 * math.sqrt(2.0) / math.pi},
        parts=[mi.SwitchingSurface("relay", "x")],
    )


def sliding_relay() -> mi.System:
    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        u = mode.relay
        return 1.35 * y.x + y.y - u, -99.93 * y.x + y.z + 2.0 * u, -5.0 * y.x - u

    parts = [mi.SwitchingSurface("relay", "x")]
    return mi.System(states=("x", "y", "z"), flow=flow, initial={"y": 0.5}, parts=parts)


def two_relays(own: float, other: float, x: float, y: float) -> mi.System:
    """x' = -own sgn x + other sgn y, y' = -other sgn x - own sgn y."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return -own * mode.x + other * mode.y, -other * mode.x - own * mode.y

    parts = [mi.SwitchingSurface("x", "x"), mi.SwitchingSurface("y", "y")]
    return mi.System(states=("x", "y"), flow=flow, initial={"x": x, "y": y}, parts=parts)


def genes() -> mi.System:
    """Two proteins whose production is switched at the levels 4 and 8."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return (
            10.0 * (1 - mode.x8) * (1 + mode.y4) - 4.5 * y.x,
            10.0 * (1 + mode.x4) * (1 - mode.y8) - 1.5 * y.y,
        )

    levels = [(name, level) for name in ("x", "y") for level in (4, 8)]
    parts = [mi.SwitchingSurface(f"{name}{level}", name, level=level) for name, level in levels]
    return mi.System(states=("x", "y"), flow=flow, initial={"x": 1.0, "y": 6.0}, parts=parts)


# --- Circuits: capacitor and coil with diodes


def coil(diodes: str) -> mi.System:
    """A load of 1 kOhm behind one diode, or behind a bridge, which always conducts."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        load = y.v / 1e3 if mode.diode == 1 or bridge else 0.0
        return -(y.i + load) / 1e-6, y.v / 1e-2

    bridge = diodes == "bridge"
    parts = [mi.SwitchingSurface("diode", "v")]
    initial, scale = {"v": 10.0}, 1e-4
    return mi.System(states=("v", "i"), flow=flow, initial=initial, time_scale=scale, parts=parts)


def filtered() -> mi.System:
    """A bridge into a capacitor and a load: while diodes conduct, the capacitors are parallel."""
    off, plus, minus = mi.modes("off", "plus", "minus")

    def charging(mode, y):  # type: ignore[no-untyped-def]
        drawn = -y.i if mode == plus else y.i
        return (drawn * 0.3 + y.w / 1e3) / 1.3

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        current = 0.0 if mode == off else charging(mode, y)
        drawn = -current if mode == minus else current
        return -(y.i + drawn) / 1e-6, y.v / 1e-2, (current - y.w / 1e3) / 3e-7

    def share(mode, y):  # type: ignore[no-untyped-def]
        v = (abs(y.v) + 0.3 * y.w) / 1.3
        return mode, (math.copysign(v, y.v), y.i, v)

    guards = [
        mi.Guard(
            "on", lambda m, t, y, p: y.w - y.v, lambda m, t, y, p: share(plus, y), modes=(off,)
        ),
        mi.Guard(
            "on reversed",
            lambda m, t, y, p: y.w + y.v,
            lambda m, t, y, p: share(minus, y),
            modes=(off,),
        ),
        mi.Guard(
            "blocks",
            lambda m, t, y, p: charging(m, y),
            lambda m, t, y, p: (off, y),
            modes=(plus, minus),
            condition=True,
        ),
    ]
    initial, scale = {"v": 10.0}, 1e-4
    states = ("v", "i", "w")
    return mi.System(states=states, flow=flow, initial=initial, time_scale=scale, guards=guards)


# --- Sampled control


def sampled(law: Callable[[float], float]) -> mi.System:
    """Two integrators, each with an input that is kept for 0.01."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        noise = math.sin(50.0 * t)
        return noise + y.a, -noise + y.b, 0.0, 0.0

    def sample(mode, t, y, p):  # type: ignore[no-untyped-def]
        return mode, (y.x, y.y, -2.0 * law(y.x), -2.0 * law(y.y))

    return mi.System(
        states=("x", "y", "a", "b"),
        flow=flow,
        initial={"x": 1.0, "y": -1.0, "a": -2.0, "b": 2.0},
        switches=tuple(k / 100.0 for k in range(1, 101)),
        switch_transition=sample,
    )


def saturation(x):  # type: ignore[no-untyped-def]
    return max(-1.0, min(1.0, x / 0.02))


def pid() -> mi.System:
    """A mass, and a controller with the errors of two samples."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.v, y.u, 0.0, 0.0, 0.0

    def sample(mode, t, y, p):  # type: ignore[no-untyped-def]
        new = -40.25625 * y.x + 80.25 * y.x1 - 40.0 * y.x2
        return mode, (y.x, y.v, y.u + new, y.x, y.x1)

    return mi.System(
        states=("x", "v", "u", "x1", "x2"),
        flow=flow,
        initial={"x": 10.0, "u": -402.5625, "x1": 10.0},
        switches=tuple(k / 20.0 for k in range(1, 2001)),
        switch_transition=sample,
    )


LOCATED: dict[str, Any] = {"late": 0, "tolerance": 1e-5}  # of LSODAR
XV, XY, VI = {"x": 1, "v": 2}, {"x": 1, "y": 2}, {"v": 1, "i": 2}
BALLS = "mechanics/BouncingBallEventDriven/BouncingBallED"
STEPPING = "mechanics/BouncingBall/BouncingBallTS"
EXAMPLES = {
    BALLS: Example(ball, XV, 200, **LOCATED),
    f"{BALLS}-initialImpact": Example(partial(ball, x=0.0, v=-1.0), XV, 200, **LOCATED),
    f"{BALLS}-TwoContacts": Example(
        partial(ball, 10.0, 0.8, v=10.0, upper=1.5), XV, 100, **LOCATED
    ),
    f"{BALLS}-withRestingContact": Example(partial(ball, e=0.0), XV, 200, **LOCATED),
    "mechanics/BouncingBallEventDriven/LinearOscillatorED": Example(
        oscillator, {**XV, "z": 7, "w": 8}, 4, **LOCATED
    ),
    "mechanics/Pendulum/SimplePendulumED_Lsodar": Example(
        pendulum, {"sin(a)": 1, "cos(a)": 2}, 100, **LOCATED
    ),
    "mechanics/ColumnOfBeads/BeadColumnED_NewtonLaw": Example(
        column, {"x0": 1, "x9": 10, "v0": 11, "v9": 20}, 1000, **LOCATED
    ),
    "mechanics/RockingBlock/RockingBlockED_NewMarkAlpha": Example(
        block, {"z": 2, "a": 3, "v": 5, "w": 6}, 1000, **LOCATED
    ),
    **{
        f"{STEPPING}{scheme}": Example(ball, XV, 200)
        for scheme in (
            "",
            "-MoreauJeanCombinedProjectionOSI",
            "-MoreauJeanDirectProjectionOSI",
            "-MoreauJeanDirectProjectionOSI-level0",
            "-MoreauJeanGOSI",
            "-SchatzmanPaoliOSI",
        )
    },
    f"{STEPPING}-D1MinusLinearOSI": Example(ball, XV, 2000),
    f"{STEPPING}-CompliantContact": Example(compliant_floor, XV, 2000),
    f"{STEPPING}-Scleronomous": Example(
        tilted, {"(x - 0.1 * z) / 1.01": 1, "(0.1 * x + z) / 1.01": 2}, 40
    ),
    "mechanics/BallOnMovingPlane/BallOnMovingPlane": Example(moving_plane, XV, 200),
    "mechanics/CamFollower/CF": Example(partial(follower, 0.0), XV, 10000),
    "mechanics/CamFollower/CamFollower-Rheonomous": Example(partial(follower, 0.4), XV, 10000),
    "mechanics/PendulumOnASlider/PendulumSlider": Example(
        slider, {"x": 1, "a": 3, "v": 4, "w": 6}, 1000
    ),
    "mechanics/FrictionOscillator/FrictionOscillator": Example(friction, XV, 100),
    "control/RelayOscillator/RelayOscillator": Example(relay, {**XY, "z": 3}, 100),
    "control/RelayOscillator/RelayOscillatorWithSliding": Example(
        sliding_relay, {**XY, "z": 3}, 100
    ),
    "control/Relay/SimpleExampleRelay": Example(partial(two_relays, 2.0, 0.0, 1.0, -1.0), XY, 1000),
    "control/Relay/Filippov": Example(partial(two_relays, 2.0, 52.0, 3.0, 3.0), XY, 1000),
    "control/Relay/Filippov_NL_py": Example(partial(two_relays, 5.0, -495.0, 3.0, 3.0), XY, 1000),
    "biology/StepSystem/simu.1.6": Example(genes, XY, 1000),
    "biology/StepSystem/sign.1.6": Example(genes, XY, 1000),
    "electronics/CircuitRLCD/CircuitRLCD": Example(partial(coil, "one"), VI, 10),
    "electronics/DiodeBridge/DiodeBridge": Example(partial(coil, "bridge"), VI, 100),
    "electronics/DiodeBridgeCapFilter/DiodeBridgeCapFilter": Example(filtered, VI, 100),
    "control/Relay/RBS": Example(partial(sampled, saturation), XY, 10000, 0, 1e-3),
    "control/PID/result": Example(pid, XV, 20, **LOCATED),
}


REFUSED = {
    "an impact with friction": (
        "mechanics/FourBarLinkageWith3clearance/FourBarClearance",
        "mechanics/ImpactingStick/ImpactingStick",
        "mechanics/SliderCrank/SliderCrankMoreauJeanCombinedProjectionOSI",
        "mechanics/SliderCrank/SliderCrankMoreauJeanDirectProjectionOSI",
        "mechanics/Woodpecker/Woodpecker",
    ),
    "an impact law of distributed stiffness": (
        "mechanics/ColumnOfBeads/BeadColumnED_LZBModel",
        "mechanics/ChainOfBalls/MonodisperseChainOfBalls-LZBModel",
        "mechanics/ChainOfBalls/TaperedChainOfBalls-LZBModel",
        "mechanics/RockingBlock/RockingBlockED_Lsodar_LZBimpact",
    ),
    "chatter of two contacts at once": (
        "mechanics/2DRigidBodies/Ball2D_kernel_only",
        "mechanics/TwoBouncingBalls/TwoBouncingBallTS-MoreauJeanGOSI",
    ),
    "sliding of second order": ("control/Relay/Twisting",),
    "a start behind a stop": (f"{STEPPING}-Dynamic",),
}


# --- Cases


def cases(folder: Path) -> Iterator[Case]:
    """Yield the cases: a reference each."""
    for name, example in EXAMPLES.items():
        yield Case(
            name=name,
            group="time-stepping" if example.late else "located events",
            values=partial(distance, example, folder / FOLDER / f"{name}.ref"),
            reference=0.0,
            absolute=example.tolerance,
            relative=0.0,
        )
    for reason, names in REFUSED.items():
        for name in names:
            refusal = {"reference": 0.0, "absolute": 0.0, "relative": 0.0}
            yield Case(name=name, group="refused", values=partial(refuse, reason), **refusal)


def refuse(reason: str) -> float:
    raise Refused(reason)


def distance(example: Example, path: Path) -> float:
    """Return the largest difference from a reference, relative to the range of its signal."""
    table = np.loadtxt(path, skiprows=0 if "_py" in path.name else 1)
    run = mi.simulate(example.system(), duration=1.1 * table[-1, 0])
    samples = run.samples(example.rate)
    place = table[:, 0] / samples["t"].iloc[1]
    grid = pd.Series(place.round().astype(int))
    rows = grid[(abs(place - grid) < 1e-5) & (grid > 0)].drop_duplicates(keep="last")
    events = np.searchsorted(run.events["t"], table[rows.index, 0], side="right")
    worst = 0.0
    for text, column in example.signals.items():
        ours, theirs = samples.eval(text).to_numpy(), table[rows.index, column]
        late = example.late * (events + 1)
        spans = [ours[max(k - n, 0) : k + n + 1] for k, n in zip(rows, late, strict=True)]
        nearest = theirs.clip([span.min() for span in spans], [span.max() for span in spans])
        worst = max(worst, abs(theirs - nearest).max() / (np.ptp(table[:, column]) or 1.0))
    return worst


SUITE = Suite(
    repository="https://github.com/siconos/siconos-tutorials",
    licence="Apache 2.0",
    files=f"{FOLDER}/**/*.ref",
    cases=cases,
)
