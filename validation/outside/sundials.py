"""Examples of SUNDIALS that locate roots: times and states of the roots."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import mems_impact as mi
from validation.outside.case import Case, Suite

__all__ = ["SUITE"]

DIGITS = 1e-4  # relative and absolute, of its testRunner


def rocket() -> mi.System:
    """A rocket whose engine stops at a height, or without fuel."""
    burning, falling = mi.modes("burning", "falling")

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        thrust = 2200.0 / (11.0 - 0.1 * t) if mode == burning else 0.0
        return y.v, thrust - 0.3 * y.v - 32.0

    def fuel(mode, t, y, p):  # type: ignore[no-untyped-def]
        return 1.0 - 0.1 * t

    def below(mode, t, y, p):  # type: ignore[no-untyped-def]
        return 4000.0 - y.h

    def stop(mode, t, y, p):  # type: ignore[no-untyped-def]
        return falling, y

    def climb(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.v

    guards = [
        mi.Guard("fuel", fuel, stop, modes=(burning,)),
        mi.Guard("height", below, stop, modes=(burning,)),
        mi.Guard("top", climb, modes=(falling,)),
    ]
    return mi.System(states=("h", "v"), flow=flow, guards=guards)


def robertson() -> mi.System:
    """Robertson's reactions, with a root of u and one of w."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        first, second, third = 0.04 * y.u, 1e4 * y.v * y.w, 3e7 * y.v**2
        return second - first, first - second - third, third

    def rest(mode, t, y, p):  # type: ignore[no-untyped-def]
        return y.u - 1e-4

    def product(mode, t, y, p):  # type: ignore[no-untyped-def]
        return 0.01 - y.w

    guards = [mi.Guard("u", rest), mi.Guard("w", product)]
    return mi.System(states=("u", "v", "w"), flow=flow, guards=guards, initial={"u": 1.0})


def kepler() -> mi.System:
    """A planet that crosses the axis."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        cube = (y.x**2 + y.y**2) ** 1.5
        return y.vx, y.vy, -y.x / cube, -y.y / cube

    guards = [
        mi.Guard("down", lambda mode, t, y, p: y.y),
        mi.Guard("up", lambda mode, t, y, p: -y.y),
    ]
    initial = {"x": 0.4, "vy": 2.0}
    return mi.System(states=("x", "y", "vx", "vy"), flow=flow, guards=guards, initial=initial)


ROOT_AFTER = re.compile(r"ROOT RETURN.*?y\[0\] = (\S+), y\[1\] = (\S+),.*\nt = (\S+),")
ROOT_BEFORE = re.compile(r"(?:At t =)?(.*)\n *rootsfound\[\] =.*")
# A system, its last root or more, a method, columns of the roots and the pattern that finds these.
EXAMPLES: dict[str, tuple[Callable[[], mi.System], float, str, list[str], re.Pattern[str]]] = {
    "cvode/serial/cvRocket_dns": (rocket, 70.0, "adams", ["t", "h", "v"], ROOT_BEFORE),
    "cvode/serial/cvRoberts_dns": (robertson, 3e7, "bdf", ["t", "u", "v", "w"], ROOT_BEFORE),
    "arkode/C_serial/ark_robertson_root": (
        robertson,
        3e7,
        "bdf",
        ["t", "u", "v", "w"],
        ROOT_BEFORE,
    ),
    "arkode/C_serial/ark_kepler_--stepper_ERK_--step-mode_fixed_--count-orbits": (
        kepler,
        100.0,
        "dop853",
        ["x", "y", "t"],
        ROOT_AFTER,
    ),
}


def cases(folder: Path) -> Iterator[Case]:
    """Yield the cases: an example each."""
    for name, (_, _, _, columns, pattern) in EXAMPLES.items():
        roots = pattern.finditer((folder / f"examples/{name}.out").read_text())
        texts = [" ".join(root.groups()) for root in roots]
        numbers = [re.findall(r"[-+]?\d+\.?\d*(?:e[-+]\d+)?", text) for text in texts]
        yield Case(
            name=name,
            group="roots",
            values=partial(values, name),
            reference=[[float(number) for number in row[: len(columns)]] for row in numbers],
            absolute=DIGITS,
            relative=DIGITS,
        )


def values(name: str) -> Any:
    """Return times and states of the roots."""
    system, duration, method, columns, _ = EXAMPLES[name]
    options = mi.Options(method=method, atol=1e-14)
    events = mi.simulate(system(), duration=duration, options=options).events
    return events.loc[events["t"] > 0.0, columns]


SUITE = Suite(
    repository="https://github.com/LLNL/sundials",
    licence="BSD 3-clause",
    files="examples/cvode/serial, examples/arkode/C_serial",
    cases=cases,
)
