"""Rows, stacks and rings of dry friction and stops between bodies, put together from parts.

Reference: `validation.judges.contacts`. Each case is run in two orders: the parts as drawn, and the
other way round with the two bodies of every friction exchanged. Values are often equal or in whole
ratios, and bodies often start at rest and in touch, since it is ties that an order may decide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mems_impact as mi
from mems_impact.errors import MemsImpactError
from validation.campaign.comparing import ONE, Unit, Verdict
from validation.judges.contacts import Bodies, Judge, Rub, Stop

Floats = NDArray[np.float64]

END = 12.0
NEAR = 1e-5  # of an impact, in time: speeds are not compared
FLOOR = 1e-7  # of the comparison
SHIFT = 1e-7  # between two runs of the reference
APART = 1e3  # times the shift, between runs of the reference that have parted
OPTIONS = {"rtol": 1e-10, "atol": 1e-12, "engine": "interpreted"}


@dataclass(frozen=True)
class Drawn:
    """One random system."""

    seed: int
    number: int

    @cached_property
    def bodies(self) -> Bodies:
        return self._drawn[0]

    @cached_property
    def start(self) -> Floats:
        return self._drawn[1]

    @cached_property
    def shape(self) -> str:
        return ("row", "stack", "ring", "any")[self.number % 4]

    @cached_property
    def _drawn(self) -> tuple[Bodies, Floats]:
        rng = np.random.default_rng([self.seed, 7, self.number])
        n = int(rng.integers(2 if self.shape == "ring" else 1, 4))
        count = int(rng.integers(1, 5))

        def some(*values: float) -> float:
            """One of a few values, or any of their size."""
            any_of_them = float(rng.uniform(min(values), max(values)))
            return float(rng.choice(values)) if rng.random() < 0.6 else any_of_them

        masses = np.array([some(1.0, 2.0, 0.5, 1.0) for _ in range(n)])
        springs, dampers = np.zeros((n, n)), np.zeros((n, n))
        for i in range(n):
            springs[i, i] += some(1.0, 0.5, 2.0) if rng.random() < 0.6 else 0.0
            dampers[i, i] += some(0.1, 0.05)
            if i and rng.random() < 0.4:
                k = some(1.0, 0.5, 2.0)
                springs[i - 1 : i + 1, i - 1 : i + 1] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
        loads = np.array([some(0.0, 0.5, -0.5, 0.25, 1.0) for _ in range(n)])
        driven = rng.random(n) < 0.5
        drive = np.where(driven, [some(0.5, 1.0, 2.0) for _ in range(n)], 0.0)
        x = np.cumsum([some(0.5, 1.0) for _ in range(n)])
        v = np.array([0.0 if rng.random() < 0.5 else some(1.0, -1.0, 0.5) for _ in range(n)])
        pairs = self.pairs(rng, n, count)
        contacts: list[Rub | Stop] = []
        for one, other in pairs:
            if rng.random() < (0.6 if self.shape == "row" else 0.25):
                side = int(rng.choice([-1, 1]))
                apart = x[one] - (0.0 if other is None else x[other])
                touches = rng.random() < 0.4
                at = apart - side * (0.0 if touches else some(0.25, 0.5, 1.0))
                if touches:
                    # At rest on it, since an impact at the start is another matter.
                    v[one] = 0.0 if other is None else v[other]
                contacts.append(
                    Stop(one, other, float(at), side, float(rng.choice([0.0, 0.0, 0.5, 0.8])))
                )
                continue
            dynamic = some(0.1, 0.2, 0.3, 0.5)
            static = dynamic * (1.0 if rng.random() < 0.5 else some(1.0, 2.0, 1.5))
            belt = some(0.3, -0.5) if other is None and rng.random() < 0.2 else 0.0
            contacts.append(Rub(one, other, dynamic, static, belt))
        if any(isinstance(each, Stop) for each in contacts) and rng.random() < 0.3:
            v[:] = 0.0
        bodies = Bodies(
            masses, springs, dampers, loads, drive, some(1.0, 0.7, 2.0), tuple(contacts)
        )
        judge = Judge(bodies)
        y = np.concatenate([x, v, [1.0, 1.0, 0.0]])
        for contact in contacts:
            if isinstance(contact, Stop) and judge.row(contact, False) @ y == 0.0:
                v[:] = 0.0  # a chain of what touches
        return bodies, np.concatenate([x, v])

    def pairs(self, rng: np.random.Generator, n: int, count: int) -> list[tuple[int, int | None]]:
        """Return between what the contacts are."""
        if self.shape == "row":
            some: list[tuple[int, int | None]] = [(i, i + 1) for i in range(n - 1)]
            some += [(i, None) for i in range(n)]
        elif self.shape == "stack":
            some = [(i, i + 1) for i in range(n - 1)] + [(n - 1, None)] * 2
        elif self.shape == "ring":
            some = [(i, (i + 1) % n) for i in range(n if n > 2 else 1)]
            some += [(i, None) for i in range(n)]
        else:
            some = [(i, None if j == n else j) for i in range(n) for j in range(i + 1, n + 1)] * 2
        chosen = rng.permutation(len(some))[:count]
        pairs = []
        for k in chosen:
            one, other = some[k]
            turned = other is not None and rng.random() < 0.5
            pairs.append((other, one) if turned else (one, other))
        return pairs  # type: ignore[return-value]

    def system(self, turned: bool) -> mi.System:
        """Return the system of the package, in one order or the other."""
        b = self.bodies
        n, omega = len(b.masses), b.omega
        masses, loads, drive = b.masses.tolist(), b.loads.tolist(), b.drive.tolist()
        springs, dampers = b.springs.tolist(), b.dampers.tolist()

        def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
            slopes = list(y[n:])
            wave = math.cos(omega * t)
            for i in range(n):
                force = loads[i] + drive[i] * wave
                for j in range(n):
                    force -= springs[i][j] * y[j] + dampers[i][j] * y[n + j]
                slopes.append(force / masses[i])
            return tuple(slopes)

        parts: list[Any] = []
        for k, contact in enumerate(b.contacts):
            v, other = f"v{contact.one}", contact.other
            if isinstance(contact, Stop):
                side = {"lower" if contact.side > 0 else "upper": contact.at}
                against = None if other is None else (f"x{other}", f"v{other}")
                parts.append(
                    mi.Stopper(f"stop{k}", f"x{contact.one}", v, restitution=contact.e,
                               against=against, **side)  # type: ignore[arg-type]
                )  # fmt: skip
                continue
            surface = contact.belt if other is None else f"v{other}"
            if turned and other is not None:
                v, surface = f"v{other}", v
            parts.append(
                mi.Friction(f"rub{k}", v, mu=contact.dynamic, static=contact.static,
                            surface=surface)
            )  # fmt: skip
        return mi.System(
            states=(*(f"x{i}" for i in range(n)), *(f"v{i}" for i in range(n))),
            flow=flow,
            period=2.0 * math.pi / omega,
            masses={f"v{i}": mass for i, mass in enumerate(masses)},
            parts=parts[::-1] if turned else parts,
            initial=mi.State(**self.named),
        )

    @property
    def touching(self) -> set[int | None]:
        """Bodies that are in contact with a stop at the start."""
        judge = Judge(self.bodies)
        y = np.concatenate([self.start, [1.0, 1.0, 0.0]])
        stops = [contact for contact in self.bodies.contacts if isinstance(contact, Stop)]
        closed = [stop for stop in stops if judge.row(stop, False) @ y == 0.0]
        return {body for stop in closed for body in (stop.one, stop.other)}

    @property
    def named(self) -> dict[str, float]:
        n = len(self.bodies.masses)
        return {f"{'xv'[k // n]}{k % n}": float(value) for k, value in enumerate(self.start)}


def check(seed: int, number: int, unit: Unit = ONE) -> Verdict:
    """Try one system in both orders."""
    drawn = Drawn(seed, number)
    judge = Judge(drawn.bodies)
    judge.follow(drawn.start, END)
    verdict = Verdict("contacts", number, len(judge.arcs), judge.until / END)
    until = judge.until - 1e-3
    if until <= 0.0:
        return verdict
    # Steps of CVODE cost most: one case in four has them.
    for turned, method in ((False, "dop853" if number % 4 else unit.method), (True, "dop853")):
        story = run(drawn, judge, until, turned, method)
        if story:
            share = agreed(drawn, judge, until)
            if share < 1.0:
                verdict.horizon *= share
                story = run(drawn, judge, until * share, turned, method) if share > 0.0 else ""
        if story:
            order = "turned" if turned else "as drawn"
            verdict.story = f"{drawn.shape}, {order}, {method}: {story}"
            break
    return verdict


def run(drawn: Drawn, judge: Judge, until: float, turned: bool, method: str) -> str:
    """Return what is wrong with a run up to a time."""
    options = mi.Options(method=method, **OPTIONS)  # type: ignore[arg-type]
    try:
        done = mi.simulate(drawn.system(turned), duration=until, options=options)
    except MemsImpactError as error:
        return f"{type(error).__name__}: {error}"
    # After each event and at the end; what goes wrong between is seen there.
    table, names = done.events, list(drawn.named)
    times = np.append(table["t"].to_numpy(), until)
    final = [getattr(done.final, name) for name in names]
    mine = np.vstack([table[names].to_numpy(dtype=float), final])
    truth = judge.at(times)
    error = np.abs(mine - truth)
    for t in judge.impacts:
        error[np.abs(times - t) < NEAR] = 0.0
    bad = np.flatnonzero(error.max(axis=1) > FLOOR * (1.0 + np.abs(truth).max(axis=1)))
    if len(bad) == 0:
        return ""
    k = bad[0]
    mode = [*table["mode after"], done.final.mode][k]
    arc = max((arc for arc in judge.arcs if arc.t <= times[k]), key=lambda arc: arc.t)
    return (
        f"off by {error[k].max():.1e} at t = {times[k]:.6g} in {mode}; "
        f"the reference since {arc.t:.6g} in {arc.modes}"
    )


def agreed(drawn: Drawn, judge: Judge, until: float) -> float:
    """Return the share of a run over which the reference agrees with itself."""
    times = np.linspace(0.0, until, 400)
    truth = judge.at(times)
    apart = np.zeros(len(times))
    n = len(drawn.bodies.masses)
    for shift in (SHIFT, -SHIFT):
        loads = drawn.bodies.loads + shift * np.arange(1.0, n + 1.0)
        aside = Judge(replace(drawn.bodies, loads=loads))
        aside.follow(drawn.start, END)
        other = aside.at(times)
        apart = np.maximum(apart, np.abs(other - truth).max(axis=1))
        apart[times > aside.until] = math.inf
    for t in judge.impacts:
        apart[np.abs(times - t) < 1e-3] = 0.0
    gone = np.flatnonzero(apart > APART * SHIFT)
    return 1.0 if len(gone) == 0 else max(0.0, (times[gone[0]] - 0.05) / until)
