"""Reference results of Modelica: friction, stops, backlash, clutches, gears, relays, switches.

Each model is a system of parts, or of modes. Continuous signals are compared at the times of the
reference that lie on its grid, to the tolerance of its logs, relative to the range of a signal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

import mems_impact as mi
from validation.outside.case import Case, Suite

__all__ = ["SUITE"]

TOLERANCE = 2e-3  # of compare_passed.log
Signal = Callable[[float], float]


@dataclass(frozen=True)
class Model:
    """A model: its system; its signals by columns of samples; its duration; rows per second."""

    system: Callable[[], mi.System]
    signals: Mapping[str, str]
    duration: float
    rate: int = 2000
    method: str = "auto"


# --- Translational


def free(mode, t, y, p):  # type: ignore[no-untyped-def]
    return y.v, 0.0


def brake() -> mi.System:
    pressing = lambda t, y, p: 2.0 if t >= 0.1 else 0.0  # noqa: E731
    return mi.System(
        states=("s", "v"),
        flow=free,
        initial={"v": 1.0},
        switches=(0.1,),
        parts=[mi.Friction("brake", "v", mu=0.5, normal=pressing)],
    )


def elastic_gaps() -> mi.System:
    """A mass between springs, s1, and a mass between gaps, s2."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.v1, -20.0 * y.s1 - 3.0 * y.v1, y.v2, 0.0

    def law(depth, rate, p):  # type: ignore[no-untyped-def]
        return 10.0 * depth + max(min(1.5 * rate, 10.0 * depth), -10.0 * depth)

    return mi.System(
        states=("s1", "v1", "s2", "v2"),
        flow=flow,
        initial={"s1": 2.0, "s2": 2.0},
        parts=[mi.Stopper("gap", "s2", "v2", lower=-0.5, upper=0.5, law=law)],
    )


def stribeck() -> mi.System:
    """A driven mass with friction, and a mass on a spring with friction and two stops."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.v1, 25.0 * math.sin(0.5 * math.pi * t), y.v2, -500.0 * (y.s2 + 0.25)

    strong = mi.Stribeck(static=15.0, dynamic=5.0, speed=0.5, viscous=1.0)
    weak = mi.Stribeck(static=8.0, dynamic=3.0, speed=0.5, viscous=1.0)
    return mi.System(
        states=("s1", "v1", "s2", "v2"),
        flow=flow,
        initial={"v2": -5.0},
        parts=[
            mi.Friction("first", "v1", mu=strong, static=15.015),
            mi.Friction("second", "v2", mu=weak, static=8.008),
            mi.Stopper("stops", "s2", "v2", lower=-0.4, upper=0.4, restitution=0.0),
        ],
    )


def compression(stiffness: float, damping: float) -> Callable[..., float]:
    """Return the law of an elastic gap, whose damping is limited by its spring."""

    def law(depth, rate, p):  # type: ignore[no-untyped-def]
        spring = stiffness * depth
        return spring + max(min(damping * rate, spring), -spring)

    return law


def preloaded_spool() -> mi.System:
    """A damped spool with flange x between two plates, a and b, on a spring between two walls."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        spring = 20e3 * (0.027 - (y.b - y.a))
        force = 150.0 * math.sin(0.02 * math.pi * t) - 2500.0 * y.x_t
        return y.x_t, force / 0.15, y.a_t, -spring / 0.01, y.b_t, spring / 0.01

    law, spool = compression(1e6, 250.0), ("x", "x_t")
    return mi.System(
        states=("x", "x_t", "a", "a_t", "b", "b_t"),
        flow=flow,
        masses={"x_t": 0.15, "a_t": 0.01, "b_t": 0.01},
        initial={"x": -0.08025, "a": -0.093, "b": -0.06925},
        parts=[
            mi.Stopper("outer_a", "a", "a_t", lower=-0.093, law=law),
            mi.Stopper("outer_b", "b", "b_t", upper=-0.0675, law=law),
            mi.Stopper("inner_a", "a", "a_t", lower=-0.01275, law=law, against=spool),
            mi.Stopper("inner_b", "b", "b_t", upper=0.01275, law=law, against=spool),
        ],
    )


def heat_losses() -> mi.System:
    """Four masses in a row: an elastic gap; friction; a brake; Stribeck friction and two stops."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        first = 100.0 * (y.s2 - y.s1 - 0.1) + 10.0 * (y.v2 - y.v1)
        second = 100.0 * (y.s3 - y.s2 - 0.1)
        third = 1e4 * (y.s4 - y.s3 - 0.1) + 1e3 * (y.v4 - y.v3)
        drive = 20.0 * math.sin(2.0 * math.pi * t) - 10.0 * y.v1
        return y.v1, drive + first, y.v2, second - first, y.v3, third - second, y.v4, -third

    pressing = lambda t, y, p: 100.0 * max(math.sin(4.0 * math.pi * t), 0.0)  # noqa: E731
    strong = mi.Stribeck(static=3.0, dynamic=1.0, speed=0.5, viscous=0.5)
    return mi.System(
        states=("s1", "v1", "s2", "v2", "s3", "v3", "s4", "v4"),
        flow=flow,
        initial={"s2": 0.1, "s3": 0.2, "s4": 0.3},
        switches=[0.25 * i for i in range(1, 8)],
        parts=[
            mi.Stopper("gap", "s1", "v1", lower=0.03, law=compression(100.0, 20.0)),
            mi.Friction("support", "v2", mu=1.0),
            mi.Friction("brake", "v3", mu=0.5, normal=pressing),
            mi.Friction("slide", "v4", mu=strong, static=3.003),
            mi.Stopper("stops", "s4", "v4", lower=0.05, upper=0.35, restitution=0.0),
        ],
    )


# --- Rotational


def backlash() -> mi.System:
    """An inertia on a spring and damper, and one with backlash."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.w1, (-20e3 * y.phi1 - 50.0 * y.w1) / 5.0, y.w2, 0.0

    def law(depth, rate, p):  # type: ignore[no-untyped-def]
        return 20e3 * depth + min(20e3 * depth, 50.0 * rate)

    half = math.pi / 8.0
    return mi.System(
        states=("phi1", "w1", "phi2", "w2"),
        flow=flow,
        masses={"w2": 5.0},
        initial={"phi1": math.pi / 2.0, "phi2": math.pi / 2.0},
        parts=[mi.Stopper("backlash", "phi2", "w2", lower=-half, upper=half, law=law)],
    )


def clutch_and_brake() -> mi.System:
    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        spring = 160.0 * (y.phi1 - y.phi2) + (y.w1 - y.w2)
        drive = 200.0 * math.sin(100.0 * t) if t < 0.5 else 0.0
        return y.w1, -spring, y.w2, spring / 0.05, y.w3, drive

    pressing = lambda t, y, p: 1600.0 if t >= 0.5 else 0.0  # noqa: E731
    return mi.System(
        states=("phi1", "w1", "phi2", "w2", "phi3", "w3"),
        flow=flow,
        masses={"w1": 1.0, "w2": 0.05, "w3": 1.0},
        initial={"w1": 90.0, "w2": 90.0, "w3": 100.0},
        switches=(0.5,),
        parts=[
            mi.Friction("clutch", "w2", surface="w3", mu=0.5, normal=160.0),
            mi.Friction("brake", "w1", mu=0.5, normal=pressing),
        ],
    )


def coupled_clutches() -> mi.System:
    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.w1, 10.0 * math.sin(10.0 * math.pi * t), y.w2, 0.0, y.w3, 0.0, y.w4, 0.0

    normals = (
        lambda t, y, p: 20.0 * max(math.cos(0.4 * math.pi * t), 0.0),
        lambda t, y, p: 20.0 if t >= 0.4 else 0.0,
        lambda t, y, p: 20.0 if t >= 0.9 else 0.0,
    )
    clutches = [
        mi.Friction(f"clutch{i}", f"w{i + 1}", surface=f"w{i}", mu=0.5, static=0.55, normal=normal)
        for i, normal in enumerate(normals, start=1)
    ]
    return mi.System(
        states=("phi1", "w1", "phi2", "w2", "phi3", "w3", "phi4", "w4"),
        flow=flow,
        masses={f"w{i}": 1.0 for i in range(1, 5)},
        initial={"w1": 10.0},
        switches=(0.4, 0.9, 1.25),
        parts=clutches,
    )


def freewheel(drive: Signal, load: float, pressing: Signal, switches: list[float]) -> mi.System:
    """Two inertias with a clutch that transmits any torque forward; pressed, 1.5 backward."""
    free, locked = mi.modes("free", "locked")

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        torque, drag = drive(t), 1.5 * pressing(t)
        mean = 0.5 * (torque + load)
        if mode == locked:
            return y.w1, mean, y.w2, mean
        return y.w1, torque + drag, y.w2, load - drag

    def overtakes(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.w2 - y.w1

    def lock(mode, t, y, p):  # type: ignore[no-untyped-def]
        return locked, (y.phi1, y.w1, y.phi2, y.w1)

    def hold(mode, t, y, p):  # type: ignore[no-untyped-def]
        return 25.0 * 1.5 * pressing(t) + 0.5 * (drive(t) - load)

    def release(mode, t, y, p):  # type: ignore[no-untyped-def]
        return free, y

    return mi.System(
        states=("phi1", "w1", "phi2", "w2"),
        flow=flow,
        modes=(free, locked),
        initial={"w1": -0.5},
        switches=switches,
        guards=[
            mi.Guard("locks", overtakes, lock, modes=(free,)),
            mi.Guard("releases", hold, release, modes=(locked,), condition=True),
        ],
    )


def one_way_clutch() -> mi.System:
    pressing = lambda t: 1.0 if 0.3 <= t < 0.95 or t >= 1.6 else 0.0  # noqa: E731
    drive = lambda t: 10.0 * math.sin(6.0 * math.pi * t)  # noqa: E731
    return freewheel(drive, 0.0, pressing, [0.3, 0.95, 1.6])


def disengaged_clutch() -> mi.System:
    drive = lambda t: 0.3 + 10.0 * math.sin(4.0 * math.pi * t)  # noqa: E731
    return freewheel(drive, -0.3, lambda t: 0.0, [])


def lossy_gear(
    drive: Signal,
    load: Signal,
    ratio: float,
    inertias: tuple[float, float],
    efficiency: float,
    losses: tuple[float, float],
    speed: float = 0.0,
    bearing: float = 0.0,
    switches: Sequence[float] = (),
) -> mi.System:
    """Two inertias, a gear whose loss depends on the driving side, and a bearing at the first.

    The loss is ``(1 - efficiency) torque + losses[0]`` if the first side drives, else ``(1 - 1 /
    efficiency) torque + losses[1]``, both equal at the torque `border`; backward the opposite.
    """
    stuck, forward, backward = mi.modes("stuck", "forward", "backward")
    border = (losses[0] - losses[1]) / (efficiency - 1.0 / efficiency)
    shares = (1.0 - efficiency, 1.0 - 1.0 / efficiency)
    inertia1, inertia2 = inertias

    def driving(t, sign, w):  # type: ignore[no-untyped-def]
        return drive(t) - bearing * (sign + ratio * w)

    def acceleration(drive, load, share, loss):  # type: ignore[no-untyped-def]
        torque = load + ratio * ((1.0 - share) * drive - loss)
        return torque / (inertia2 + ratio**2 * (1.0 - share) * inertia1)

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        if mode == stuck:
            return 0.0, 0.0
        sign = 1.0 if mode == forward else -1.0
        torque = driving(t, sign, y.w)
        rate = acceleration(torque, load(t), shares[0], sign * losses[0])
        if sign * (torque - inertia1 * ratio * rate) < border:
            rate = acceleration(torque, load(t), shares[1], sign * losses[1])
        return y.w, rate

    def room(t, sign):  # type: ignore[no-untyped-def]
        torque = sign * driving(t, sign, 0.0)
        i = 0 if torque > border else 1
        return shares[i] * torque + losses[i] - torque - sign * load(t) / ratio

    to = lambda after: lambda mode, t, y, p: (after, (y.phi, 0.0))  # noqa: E731
    guards = []
    for mode, sign in ((forward, 1.0), (backward, -1.0)):

        def rolls(mode, t, y, p, sign=sign):  # type: ignore[no-untyped-def]
            return sign * y.w

        def holds(mode, t, y, p, sign=sign):  # type: ignore[no-untyped-def]
            return room(t, sign)

        guards += [
            mi.Guard(f"{mode.name} ends", rolls, to(stuck), modes=(mode,)),
            mi.Guard(f"{mode.name} begins", holds, to(mode), modes=(stuck,), condition=True),
        ]
    return mi.System(
        states=("phi", "w"),
        flow=flow,
        modes=(stuck, forward, backward),
        initial=mi.State(phi=0.0, w=speed, mode="forward" if speed else "stuck"),
        switches=switches,
        guards=guards,
    )


def half_efficient_gear(bearing: float) -> mi.System:
    drive = lambda t: 10.0 * math.sin(2.0 * math.pi * t)  # noqa: E731
    load = lambda t: -10.0 + 2.5 * t  # noqa: E731
    return lossy_gear(drive, load, 2.0, (1.0, 1.5), 0.5, (0.0, 0.0), bearing=bearing)


def rubbing_gear() -> mi.System:
    load = lambda t: 1.0 if t >= 0.5 else 0.0  # noqa: E731
    inertias, losses = (0.001, 0.001), (0.625, 2.5)
    return lossy_gear(lambda t: 0.0, load, 1.0, inertias, 0.25, losses, 10.0, switches=[0.5])


def gear_shift() -> mi.System:
    """A planetary gear between an engine and a load, its ring on a brake and on a clutch.

    No part has this friction: the speed of the ring is (2.5 load - engine) / 1.5.
    """
    held, forward, backward, locked = mi.modes("held", "forward", "backward", "locked")

    def closing(t):  # type: ignore[no-untyped-def]
        return min(max((t - 2.0) / 0.1, 0.0), 1.0)

    def torques(mode, t, y):  # type: ignore[no-untyped-def]
        """Return the torques of engine, load, brake and clutch; the latter two act on the ring."""
        engine = 20.0 if t >= 0.5 else 0.0
        load = -20.0 * (y.w2 / 10.471975511966) ** 2
        brake, clutch = 100.0 * (1.0 - closing(t)), 100.0 * closing(t)
        if mode == held:
            return engine, load, (engine - clutch - 0.25 * load) * 12.0 / 13.0 - clutch, clutch
        brake = brake if mode == backward else -brake
        if mode == locked:
            clutch = (engine + brake - 0.1 * load) * 6.0 / 11.0 - brake
        return engine, load, brake, clutch

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        engine, load, brake, clutch = torques(mode, t, y)
        ring = (brake + clutch) / 1.5
        return y.w1, engine - ring - clutch, y.w2, 0.1 * (load + 2.5 * ring)

    def limit(sign: float) -> Callable[..., float]:
        return lambda mode, t, y, p: 100.0 * (1.0 - closing(t)) + sign * torques(mode, t, y)[2]

    to = lambda after: lambda mode, t, y, p: (after, y)  # noqa: E731
    guards = [
        mi.Guard("slips forward", limit(1.0), to(forward), modes=(held,), condition=True),
        mi.Guard("slips backward", limit(-1.0), to(backward), modes=(held,), condition=True),
        mi.Guard(
            "locks",
            lambda mode, t, y, p: y.w1 - y.w2,
            lambda mode, t, y, p: (locked, (y.phi1, y.w2, y.phi2, y.w2)),
            modes=(forward, backward),
        ),
        mi.Guard("stops", lambda mode, t, y, p: y.w1 - 2.5 * y.w2, to(held), modes=(backward,)),
    ]
    return mi.System(
        states=("phi1", "w1", "phi2", "w2"),
        flow=flow,
        modes=(held, forward, backward, locked),
        guards=guards,
        switches=(0.5, 2.0, 2.1),
    )


# --- Relays, saturations, switches


def controlled_temperature() -> mi.System:
    """A resistor with a heat capacity; a switch follows a ramp."""

    def error(t, y, p):  # type: ignore[no-untyped-def]
        return y.T - 298.15 - 25.0 * min(max((t - 2.0) / 6.0, 0.0), 1.0)

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        resistance = 10.0 * (1.0 + (y.T - 293.15) / 255.0)
        power = 100.0 / resistance if mode.off == 0 else 0.0
        return (power - 0.1 * (y.T - 293.15),)

    return mi.System(
        states=("T",),
        flow=flow,
        initial={"T": 293.15},
        switches=(2.0, 8.0),
        parts=[mi.Relay("off", error, lower=-1.0, upper=1.0)],
    )


def rate_limiters() -> mi.System:
    """A limit of velocity, then one of acceleration."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        step = 1.0 if t >= 0.1 else 0.0
        speed = (step - y.x) / 1e-4 if mode.v == 0 else 2.0 * mode.v
        return speed, (speed - y.w) / 1e-4, y.w

    return mi.System(
        states=("x", "w", "s"),
        flow=flow,
        switches=(0.1,),
        parts=[mi.RateLimit("v", "x", limit=2.0), mi.RateLimit("a", "w", limit=20.0)],
    )


def arc(level: float, is_closed: bool) -> mi.System:
    """An ideal switch and one with an arc, closed while sin(2 pi t) is above `level`.

    The state `off` is the time since which the switch is off.
    """
    opened, closed, burning = mi.modes("opened", "closed", "burning")

    def voltage(t, y):  # type: ignore[no-untyped-def]
        return min(60.0, 30.0 + 1e4 * (t - y.off))

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        first = 1e-5 * y.i1 if mode == closed else 1e5 * y.i1
        second = voltage(t, y) if mode == burning else 1e5 * y.i2
        second = 1e-5 * y.i2 if mode == closed else second
        return (50.0 - y.i1 - first) / 0.1, (50.0 - y.i2 - second) / 0.1, 0.0

    def falls(mode, t, y, p):  # type: ignore[no-untyped-def]
        return math.sin(2.0 * math.pi * t) - level

    def rises(mode, t, y, p):  # type: ignore[no-untyped-def]
        return level - math.sin(2.0 * math.pi * t)

    def quench(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.i2 - 1e-5 * voltage(t, y)

    guards = [
        mi.Guard("off", falls, lambda mode, t, y, p: (burning, (y.i1, y.i2, t)), modes=(closed,)),
        mi.Guard("on", rises, lambda mode, t, y, p: (closed, y), modes=(opened, burning)),
        mi.Guard("quenched", quench, lambda mode, t, y, p: (opened, y), modes=(burning,)),
    ]
    return mi.System(
        states=("i1", "i2", "off"),
        flow=flow,
        guards=guards,
        modes=(opened, closed, burning),
        initial=mi.State(i1=0.0, i2=0.0, off=0.0, mode="closed" if is_closed else "opened"),
    )


CLUTCH = {
    "inertiaIn.phi": "phi1",
    "inertiaIn.w": "w1",
    "oneWayClutch.phi_rel": "phi2 - phi1",
    "oneWayClutch.w_rel": "w2 - w1",
}
GEAR = {"Inertia2.phi": "phi", "Inertia2.w": "w"}
ARC = {"inductor1.i": "i1", "inductor2.i": "i2"}
MODELS = {
    "Mechanics/Translational/Examples/Brake": Model(
        brake, {"mass1.s": "s", "mass1.v": "v", "mass2.s": "s", "mass2.v": "v"}, 2.0
    ),
    "Mechanics/Translational/Examples/ElastoGap": Model(
        elastic_gaps,
        {
            "springDamper1.v_rel": "v1",
            "springDamper2.s_rel": "2 - s1",
            "elastoGap1.v_rel": "v2",
            "elastoGap2.s_rel": "2 - s2",
        },
        5.0,
        200,
    ),
    "Mechanics/Translational/Examples/Friction": Model(
        stribeck, {"stop1.s": "s1", "stop1.v": "v1", "stop2.s": "s2", "stop2.v": "v2"}, 5.0
    ),
    "Mechanics/Rotational/Examples/Backlash": Model(
        backlash,
        {
            "springDamper.phi_rel": "phi1",
            "springDamper.w_rel": "w1",
            "elastoBacklash.phi_rel": "phi2",
            "elastoBacklash.w_rel": "w2",
        },
        1.0,
    ),
    "Mechanics/Rotational/Examples/Friction": Model(
        clutch_and_brake,
        {
            "clutch.phi_rel": "phi2 - phi3",
            "clutch.w_rel": "w2 - w3",
            "inertia3.phi": "phi3",
            "inertia3.w": "w3",
            "spring.phi_rel": "phi1 - phi2",
            "spring.w_rel": "w1 - w2",
        },
        3.0,
    ),
    "Mechanics/Rotational/Examples/CoupledClutches": Model(
        coupled_clutches,
        {
            "J1.phi": "phi1",
            "J1.w": "w1",
            **{
                f"clutch{i}.{x}_rel": f"{x}{i + 1} - {x}{i}"
                for i in (1, 2, 3)
                for x in ("phi", "w")
            },
        },
        1.5,
    ),
    "Mechanics/Translational/Examples/PreLoad": Model(
        preloaded_spool,
        {
            "friction.v_rel": "x_t",
            "innerContactA.s_rel": "a - x + 0.01375",
            "innerContactB.s_rel": "x - b + 0.01375",
            "outerContactA.v_rel": "a_t",
            "outerContactB.s_rel": "-0.066 - b",
            "outerContactB.v_rel": "-b_t",
        },
        100.0,
        20,
    ),
    "Mechanics/Translational/Examples/HeatLosses": Model(
        heat_losses,
        {
            "damper.s_rel": "0.05 - s1",
            "damper.v_rel": "-v1",
            "massWithStopAndFriction.s": "s4",
            "massWithStopAndFriction.v": "v4",
            "springDamper.s_rel": "s2 - s1 - 0.1",
            "springDamper.v_rel": "v2 - v1",
            "springDamper1.s_rel": "s4 - s3 - 0.1",
            "springDamper1.v_rel": "v4 - v3",
        },
        2.0,
    ),
    "Mechanics/Rotational/Examples/OneWayClutch": Model(one_way_clutch, CLUTCH, 2.0),
    "Mechanics/Rotational/Examples/OneWayClutchDisengaged": Model(disengaged_clutch, CLUTCH, 2.0),
    "Mechanics/Rotational/Examples/LossyGearDemo1": Model(
        partial(half_efficient_gear, 0.0), GEAR, 0.5
    ),
    "Mechanics/Rotational/Examples/LossyGearDemo2": Model(
        partial(half_efficient_gear, 0.5), GEAR, 0.5
    ),
    "Mechanics/Rotational/Examples/LossyGearDemo3": Model(rubbing_gear, GEAR, 1.0),
    "Mechanics/Rotational/Examples/SimpleGearShift": Model(
        gear_shift,
        {
            "clutch.phi_rel": "(phi2 - phi1) / 0.6",
            "clutch.w_rel": "(w2 - w1) / 0.6",
            "engine.phi": "phi1",
            "engine.w": "w1",
            "load.phi": "phi2",
            "load.w": "w2",
        },
        5.0,
        200,
    ),
    "Thermal/HeatTransfer/Examples/ControlledTemperature": Model(
        controlled_temperature, {"heatCapacitor.T": "T"}, 10.0
    ),
    "Blocks/Examples/SlewRateLimiter": Model(
        rate_limiters, {"limit_v.y": "x", "limit_a.y": "w", "positionSmoothed.y": "s"}, 1.0
    ),
    "Electrical/Analog/Examples/SwitchWithArc": Model(lambda: arc(0.0, True), ARC, 2.0, 8000),
    "Electrical/Analog/Examples/ControlledSwitchWithArc": Model(
        lambda: arc(0.5, False), ARC, 6.0, 8000
    ),
}


# --- Cases


def cases(folder: Path) -> Iterator[Case]:
    """Yield the cases: a model each."""
    for name, model in MODELS.items():
        path = folder / "Modelica" / name / f"{name.split('/')[-1]}.csv"
        table = pd.read_csv(path)
        place = table["time"] * model.rate
        rows = table[(place - place.round()).abs() < 1e-6].groupby(place.round()).last()
        reference = rows[list(model.signals)]
        size = reference.max() - reference.min()
        yield Case(
            name=name,
            group=name.split("/")[0],
            values=partial(values, name, size),
            reference=reference / size,
            absolute=TOLERANCE,
            relative=0.0,
        )


def values(name: str, size: Any) -> Any:
    """Return the signals, relative to their sizes, at the times of the grid."""
    model = MODELS[name]
    options = mi.Options(method=model.method)
    run = mi.simulate(model.system(), duration=model.duration, options=options)
    samples = run.samples(model.rate)
    return pd.DataFrame({each: samples.eval(text) for each, text in model.signals.items()}) / size


SUITE = Suite(
    repository="https://github.com/modelica/MAP-LIB_ReferenceResults",
    licence="BSD 3-clause",
    files="Modelica/{Mechanics,Thermal,Blocks,Electrical}",
    cases=cases,
)
