"""Random devices with random terms under random drives from random starts.

The package composes equations of what each term contributes; the reference has all of them written
out in one piece. Each motion is accounted for besides: what the forces of the package's terms do
along it is what they store and lose.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import DOP853

import mems_impact as mi
from mems_impact import Options
from mems_impact.actuator.automaton import direction_of
from mems_impact.actuator.model import Model, compose
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.terms import TERM_CLASSES
from mems_impact.actuator.terms.files import term_of, term_type
from validation.campaign import comparing, drives
from validation.campaign.cases import hold_voltage
from validation.campaign.comparing import END, ONE, RTOL, Row, Unit, Verdict
from validation.campaign.integrating import (
    CLEAR,
    FLIGHT,
    IN_AN_INSTANT,
    NEAR,
    STEEP,
    Floats,
    Follower,
    Undecided,
)
from validation.judges import with_terms
from validation.judges.heyoka_full import Piece
from validation.judges.with_terms import LEFT_SOURCE, RIGHT_SOURCE, TERMS, Device, decades, volts

COMPILED = 25  # one case in so many runs on the compiled engine, which takes seconds to make
COMBINATIONS = 8  # of terms, compiled
LIKELY = 0.35  # how likely a case has each term
SWITCHES = 30  # of a drive in a run, at most
BALANCED = 1e-8  # energy that may be missing, by what was turned over
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)

Values = dict[str, Any]
Rng = np.random.Generator


JUDGED = [
    name for name in TERM_CLASSES if name in TERMS and TERMS[name].places is not None
]  # fmt: skip


class Drawn:
    """One case."""

    def __init__(self, seed: int, number: int) -> None:
        rng = np.random.default_rng([seed, 7, number])
        self.compiled = number % COMPILED == COMPILED // 2
        kinds = rng
        if self.compiled:  # of few shapes, each of which has to be compiled
            kinds = np.random.default_rng([7, number // COMPILED % COMBINATIONS])
        chosen = _one_of_each([name for name in JUDGED if kinds.random() < LIKELY], kinds)
        chosen = chosen or [str(kinds.choice(JUDGED))]
        self.device = _device(rng)
        self.terms = {name: TERMS[name].draw(rng, self.device) for name in chosen}
        if self.compiled and "squeeze_film" in chosen:
            self.terms["squeeze_film"] |= {"sides": "both", "modes": 1}
        if self.compiled:
            for name in with_terms.KINDS:
                if name in chosen:
                    self.terms[name]["sides"] = "both"
            self.terms.get("fringing", {}).pop("length", None)
            table = self.terms.get("tabulated_restitution", {})
            table |= {name: each[:2] for name, each in table.items()}
        if self.compiled or "charge_drive" in chosen:  # no voltage to follow, or one shape more
            self.terms.get("clamp_electrode", {})["follows"] = "nothing"
        self.drive = drives.random_spec(rng, hold_voltage(self.device), 1.0)
        while self.compiled and self.drive.kind != "sine":
            self.drive = drives.random_spec(rng, hold_voltage(self.device), 1.0)
        self.start = _start(rng, self.device, self.drive.pieces()(0.0))
        if "compliant_stopper" in chosen and self.start[3] == 0.0:
            self.start[2] *= 1.002  # rest begins in touch
        end, length = 0.0, rng.uniform(6.0, 20.0)
        for _ in range(SWITCHES):
            end = self.drive.pieces()(end).end
        self.end = float(min(end, length))

    @property
    def system(self) -> ActuatorSystem:
        """The case as the package has it."""
        terms = tuple(term_of(name, values) for name, values in self.terms.items())
        return mi.Actuator(**self.device, terms=terms).under(self.drive.build())


def fitting_term(name: str, device: mi.Actuator, seed: int = 0) -> mi.Term:
    """Return a term of random numbers that fits a device with units."""
    values = TERMS[name].draw(np.random.default_rng(seed), dict(device.to_dimensionless()))
    return term_of(name, values).unscaled(device.scales)


def _one_of_each(names: list[str], rng: Rng) -> list[str]:
    """Return the names but those that would take the place of the same rule."""
    mixed = [names[i] for i in rng.permutation(len(names))]
    taken = {term_type(name).replaced_rule or name: name for name in mixed}
    if "stopper" in taken:  # it has its own losses
        taken.pop("restitution", None)
    return [name for name in names if name in taken.values()]


def _device(rng: Rng) -> Values:
    p = {"m1": decades(rng, -0.3, 1.0), "m2": 1.0, "k": rng.uniform(0.5, 2.0)}
    p |= {"c": float(rng.choice([0.0, rng.uniform(0.0, 0.2)], p=[0.2, 0.8])), "d": 1.0}
    p |= {"delta": rng.uniform(0.2, 0.8), "alpha": decades(rng, -0.5, 0.5), "g": 9.81}
    p["e"] = float(rng.choice([rng.uniform(0.2, 0.9), 0.0], p=[0.8, 0.2]))
    p["mu_s"] = decades(rng, -3.3, -0.3)
    p["mu_d"] = p["mu_s"] * rng.uniform(0.3, 0.95)
    return p


def _start(rng: Rng, p: Values, piece: Piece) -> list[float]:
    """Return a start on the way, or, where the voltage holds the block there, on a stopper."""
    speed = p["delta"] * math.sqrt(p["k"] / p["m2"])
    v1 = float(rng.choice([0.0, 0.5 * speed * rng.normal()]))
    for side, source in ((1.0, piece.right), (-1.0, piece.left)):
        if abs(source.at(0.0)) > 1.2 * hold_voltage(p) and rng.random() < 0.6:
            return [0.0, v1, side * p["delta"], 0.0]
    return [0.0, v1, p["delta"] * rng.uniform(-0.9, 0.9), 1.5 * speed * rng.normal()]


class _Judged(Device):
    """The device, as far as the package's equations are meant to go."""

    def margins(self, mode: int, t: Any, y: Floats) -> tuple[Floats, Floats]:
        p = self.p
        furthest = 0.5 * (p[with_terms.DELTA] + p[with_terms.D])
        if mode // 3 != 0 and np.abs(y[..., 2]).max() > furthest:
            raise Undecided  # the force of an electrode is not followed to where it is infinite
        return super().margins(mode, t, y)


class _Follower(Follower):
    """One motion, which is given up where a sequence of impacts ends."""

    def __init__(self, system: Device, y: Floats, rtol: float) -> None:
        self.device, self.until = system, system.enter(0.0)
        super().__init__(system, system.settled(0.0, y), 0.0, y, rtol)
        self.arcs: list[tuple[int, float, Floats, float]] = []

    def follow(self, end: float, most: int = 60) -> tuple[list[Row], float]:
        """Return the events up to `end`, and how far they are known."""
        try:
            while len(self.rows) < most:
                if self._arc(min(end, self.until)):
                    continue
                if end <= self.until:
                    self.rows.append(Row(end, END, self.mode, self.y))
                    return self.rows, end
                self.until = self.device.enter(self.t)
                self.mode = self.device.settled(self.t, self.y)
        except Undecided:
            pass
        return self.rows, self.t

    def _arc(self, end: float) -> bool:
        began = self.mode, self.t, self.y
        found = super()._arc(end)
        self.arcs.append((*began, self.rows[-1].t if found else end))
        return found

    def _carry_out(self, guard: int, y: Floats, fall: float) -> None:
        for _ in range(IN_AN_INSTANT):
            last = self.mode
            self.mode, self.y = self.device.fire(last, guard, self.t, y)
            self.rows.append(Row(self.t, guard, self.mode, self.y, fall))
            if self.system.impact[guard] and self._rests(guard, last):
                return
            values, rates = self.device.margins(self.mode, self.t, self.y)
            self._let_go(guard, values)
            zero = np.abs(values) < NEAR
            clear = zero & (np.abs(rates) > self.steep)
            if np.any((values < NEAR) & (values > -CLEAR) & ~clear):
                raise Undecided
            fires = (values < -CLEAR) | (zero & (rates < 0.0))
            if not fires.any():
                return
            guard, y, fall = int(np.argmax(fires)), self.y, math.inf
        raise Undecided

    def _let_go(self, guard: int, values: Floats) -> None:
        """Leave the stopper out on which the block is at rest, and from which it is pulled away."""
        if self.mode // 3 != 0 or self.y[3] != 0.0:
            return
        side = with_terms.RIGHT if self.y[2] > 0.0 else with_terms.LEFT
        away = float(self.device.flow(self.mode, self.t, self.y)[3]) * (1 - 2 * (side == 0))
        if guard != with_terms.RELEASE and away < STEEP:
            raise Undecided
        values[side] = math.inf

    def _rests(self, guard: int, last: int) -> bool:
        rate = self.system.margins(self.mode, self.t, self.y)[1][guard]
        h = 1e-6
        y = self.y + h * self.system.flow(self.mode, self.t, self.y)
        pressure = (rate - self.system.margins(self.mode, self.t + h, y)[1][guard]) / h
        if 0.0 < 2.0 * rate <= FLIGHT * pressure:
            raise Undecided
        return False


def check(seed: int, number: int, unit: Unit = ONE) -> Verdict:
    """Try one case."""
    drawn = Drawn(seed, number)
    system = drawn.system
    judge = _Judged(drawn.device, drawn.terms, drawn.drive.pieces())
    places = [judge.states.index(name) for name in system.states]
    start = np.zeros(len(judge.states))
    start[:4] = drawn.start
    aside = np.zeros(len(judge.states))
    rng = np.random.default_rng([seed, 8, number])
    aside[places] = rng.normal(size=len(places))
    aside[0] = 0.0
    aside[1] *= start[1] != 0.0
    if start[3] == 0.0:
        aside[2:4] = 0.0
    first: list[_Follower] = []

    def follow(shift: float) -> tuple[list[Row], float]:
        y = start + shift * aside / max(float(np.linalg.norm(aside)), 1.0)
        one = _Follower(judge, y, 1e-12 if shift == 0.0 else 1e-9)
        first.append(one)
        rows, quiet = one.follow(drawn.end)
        return [_placed(row, places) for row in rows], quiet

    found = comparing.truth(follow, drawn.end)
    engine = "compiled" if drawn.compiled else "interpreted"
    options = Options(**unit.options, engine=engine)
    values = dict(zip(judge.states, drawn.start, strict=False))
    # An event that is nearly a graze makes more of the package's own error than of the shift. Such
    # a difference goes with the tolerance; what is wrong stays.
    for tight in (1.0, 1e-2):
        problem = system.problem(replace(options, rtol=RTOL * tight, atol=options.atol * tight))
        instant = system.state_space.instant(mi.State(**values), problem)
        mine = comparing.answer(problem, instant, found.quiet, np.ones(len(places)), 1.0)
        story = comparing.compare(found, mine)
        if not story:
            break
    if not story:
        account = partial(imbalance, system, judge, places, problem.parameters)
        for arc in first[0].arcs:
            for what, missing in zip(("energy", "momentum"), account(*arc), strict=True):
                if missing > BALANCED and arc[3] <= found.quiet:
                    story = f"{what} off by {missing:.1e} from t = {arc[1]:.6g} to {arc[3]:.6g}"
    return Verdict("terms", number, len(found.rows), found.share, story)


def _placed(row: Row, places: list[int]) -> Row:
    return Row(row.t, row.guard, row.mode, row.y[places], row.fall, row.rest, row.blur)


def imbalance(
    system: ActuatorSystem,
    judge: Device,
    places: list[int],
    p: Floats,
    mode: int,
    t: float,
    y: Floats,
    end: float,
) -> Floats:
    """Return energy and momentum missing after an arc of the reference, by what was turned over."""
    sides = 1 if system.drive.left_voltage is None else 2
    model = compose(system._kinds, sides)
    if end - t < 1e-9:
        return np.zeros(2)
    judge.enter(t)
    solver = DOP853(partial(judge.flow, mode), t, y, end, rtol=1e-12, atol=1e-14, max_step=0.5)
    before = stored(model, y[places], p)
    done, turned = np.zeros(2), np.ones(2)
    sums = [True, direction_of(mode) != 0]  # a frame that is held takes momentum from the ground
    while solver.status == "running":
        solver.step()
        dense, half = solver.dense_output(), 0.5 * (solver.t - solver.t_old)
        for node, weight in zip(NODES, WEIGHTS, strict=True):
            now = solver.t_old + half * (1.0 + node)
            parts = powers(judge, model, mode, now, dense(now)[places], p)
            done += half * weight * parts.sum(axis=1)
            turned += half * weight * np.abs(parts).sum(axis=1)
    missing: Floats = np.abs(stored(model, solver.y[places], p) - before - done) / turned * sums
    return missing


def stored(model: Model, y: Floats, p: Floats) -> Floats:
    """Return the energy of bodies, spring and terms, and the momentum of the bodies."""
    m1, m2, k = p[:3]
    moving = 0.5 * m1 * y[1] ** 2 + 0.5 * m2 * (y[1] + y[3]) ** 2 + 0.5 * k * y[2] ** 2
    energy = moving + sum(part.energy(y, p) for part in model.contributions if part.energy)
    return np.array([energy, m1 * y[1] + m2 * (y[1] + y[3])])


def powers(judge: Device, model: Model, mode: int, t: float, y: Floats, p: Floats) -> Floats:
    """Return the powers that come in and are lost, and the forces from outside and of friction."""
    right, left = (volts(judge.p, first, t) for first in (RIGHT_SOURCE, LEFT_SOURCE))
    way = direction_of(mode)
    pulled = model.pull(right, left, y, p) * y[3]
    normal = model.normal_force(right, left, 0.0, p)
    friction = model.sliding_friction(way, y[1], normal, p) if way != 0 else 0.0
    lost = p[3] * y[3] ** 2 + friction * y[1]
    lost += sum(part.dissipation(y, p) for part in model.contributions if part.dissipation)
    return np.array([[pulled, -lost], [model.on_frame(y, p) + model.on_block(y, p), -friction]])
