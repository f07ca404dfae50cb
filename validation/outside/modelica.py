"""Reference results of Modelica's mechanics: friction, stops, backlash, clutches, brakes.

Each model is a system of parts. Continuous signals are compared at the times of the reference that
lie on its grid, to the tolerance of its logs, relative to the range of a signal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

import mems_impact as mi
from validation.outside.case import Case, Suite

__all__ = ["SUITE"]

TOLERANCE = 2e-3  # of compare_passed.log


@dataclass(frozen=True)
class Model:
    """A model: its system; its signals by columns of samples; its duration; rows per second."""

    system: Callable[[], mi.System]
    signals: Mapping[str, str]
    duration: float
    rate: int = 2000


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


MODELS = {
    "Translational/Examples/Brake": Model(
        brake, {"mass1.s": "s", "mass1.v": "v", "mass2.s": "s", "mass2.v": "v"}, 2.0
    ),
    "Translational/Examples/ElastoGap": Model(
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
    "Translational/Examples/Friction": Model(
        stribeck, {"stop1.s": "s1", "stop1.v": "v1", "stop2.s": "s2", "stop2.v": "v2"}, 5.0
    ),
    "Rotational/Examples/Backlash": Model(
        backlash,
        {
            "springDamper.phi_rel": "phi1",
            "springDamper.w_rel": "w1",
            "elastoBacklash.phi_rel": "phi2",
            "elastoBacklash.w_rel": "w2",
        },
        1.0,
    ),
    "Rotational/Examples/Friction": Model(
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
    "Rotational/Examples/CoupledClutches": Model(
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
}


# --- Cases


def cases(folder: Path) -> Iterator[Case]:
    """Yield the cases: a model each."""
    for name, model in MODELS.items():
        path = folder / "Modelica/Mechanics" / name / f"{name.split('/')[-1]}.csv"
        table = pd.read_csv(path)
        place = table["time"] * model.rate
        rows = table[(place - place.round()).abs() < 1e-6].groupby(place.round()).last()
        reference = rows[list(model.signals)]
        size = reference.max() - reference.min()
        yield Case(
            name=name,
            group="friction, stops, clutches, brakes",
            values=partial(values, name, size),
            reference=reference / size,
            absolute=TOLERANCE,
            relative=0.0,
        )


def values(name: str, size: Any) -> Any:
    """Return the signals, relative to their sizes, at the times of the grid."""
    model = MODELS[name]
    samples = mi.simulate(model.system(), duration=model.duration).samples(model.rate)
    return pd.DataFrame({each: samples.eval(text) for each, text in model.signals.items()}) / size


SUITE = Suite(
    repository="https://github.com/modelica/MAP-LIB_ReferenceResults",
    licence="BSD 3-clause",
    files="Modelica/Mechanics",
    cases=cases,
)
