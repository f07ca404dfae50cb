"""Bodies on a line, joined by springs, dry friction and stops: an independent judge of the package.

In each mode the motion is linear, y' = A y with 1, cos and sin of the drive among the states, and
is followed by the exponential of A. Which mode comes next is not derived from accelerations: every
combination of what may stick, slide, touch and part is followed for a moment, and the one that
stays true to itself is taken. Forces that statics leaves undetermined are tried at the vertices of
what limits allow. It uses nothing of `mems_impact`.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq

Floats = NDArray[np.float64]
Modes = tuple[int, ...]
Vertex = tuple[Floats, list[int]]  # rows, and the contact of each

MOMENT = 1e-4  # for which a mode is tried
STEP = 0.01  # between looks at what must stay positive
BLOCK = 100  # looks at a time
REST = 1e-8  # speeds and gaps below it are none
TRUE = 1e-10  # by which a speed may be on the wrong side after a moment
BORNE = 1e-8  # by which a force may be beyond its limits
SEEN = 1e-9  # margins below its negative have been crossed
CLOSE = 1e-5  # what comes so near to zero may be crossed or not
SEQUENCE = 0.02  # impacts of a stop so near in time are the end of a sequence


@dataclass(frozen=True)
class Rub:
    """Dry friction of `one` on `other`, a body, or on something of the speed `belt`."""

    one: int
    other: int | None
    dynamic: float
    static: float
    belt: float = 0.0


@dataclass(frozen=True)
class Stop:
    """A stop: ``side * (x_one - x_other - at) >= 0``."""

    one: int
    other: int | None
    at: float
    side: int
    e: float


@dataclass(frozen=True)
class Bodies:
    """What there is.

    Attributes
    ----------
    masses : Floats
    springs, dampers : Floats
        Matrices: forces are ``-springs @ x - dampers @ v + loads + drive cos(omega t)``.
    loads, drive : Floats
    omega : float
    contacts : tuple of Rub or Stop
    """

    masses: Floats
    springs: Floats
    dampers: Floats
    loads: Floats
    drive: Floats
    omega: float
    contacts: tuple[Rub | Stop, ...]


class Unclear(Exception):
    """Where the mechanics leave the motion open, or rounding decides."""


@dataclass
class Arc:
    """The motion in one mode from `t` on: ``y`` is x, v, 1, cos, sin."""

    t: float
    modes: Modes
    matrix: Floats
    y: Floats


@dataclass
class Judge:
    """The motion of bodies from a start.

    Attributes
    ----------
    arcs : list of Arc
    impacts : list of float
    stops : list of int
        Of which contact each impact was.
    until : float
        Up to where the motion is determined.
    why : str
        What ended it, if it ended early.
    """

    bodies: Bodies
    arcs: list[Arc] = field(default_factory=list)
    impacts: list[float] = field(default_factory=list)
    stops: list[int] = field(default_factory=list)
    until: float = 0.0
    why: str = ""

    def __post_init__(self) -> None:
        self.n = len(self.bodies.masses)
        self.size = 2 * self.n + 3
        self.made: dict[Modes, tuple[Floats, list[Vertex]]] = {}
        self.steps: dict[Modes, Floats] = {}

    # Rows that give, of y, what contacts see.

    def row(self, contact: Rub | Stop, speed: bool) -> Floats:
        row = np.zeros(self.size)
        offset = self.n if speed else 0
        row[offset + contact.one] = 1.0
        if contact.other is not None:
            row[offset + contact.other] -= 1.0
        if isinstance(contact, Rub):
            row[2 * self.n] = -contact.belt if speed else 0.0
        elif not speed:
            row[2 * self.n] = -contact.at
        return row * (contact.side if isinstance(contact, Stop) else 1)

    def push(self, contact: Rub | Stop) -> Floats:
        """Return on which bodies a unit of force acts."""
        push = np.zeros(self.n)
        push[contact.one] = 1.0
        if contact.other is not None:
            push[contact.other] -= 1.0
        return push * (contact.side if isinstance(contact, Stop) else 1)

    def held(self, modes: Modes) -> list[int]:
        return [
            i
            for i, (contact, mode) in enumerate(zip(self.bodies.contacts, modes, strict=True))
            if (mode == 0) == isinstance(contact, Rub)
        ]

    def made_of(self, modes: Modes) -> tuple[Floats, list[Vertex]]:
        """Return A, and vertices of the forces that hold: rows that must not be negative."""
        if modes in self.made:
            return self.made[modes]
        b, n = self.bodies, self.n
        force = np.zeros((n, self.size))
        force[:, :n], force[:, n : 2 * n] = -b.springs, -b.dampers
        force[:, 2 * n], force[:, 2 * n + 1] = b.loads, b.drive
        for contact, mode in zip(b.contacts, modes, strict=True):
            if isinstance(contact, Rub) and mode != 0:
                force[:, 2 * n] -= mode * contact.dynamic * self.push(contact)
        held = self.held(modes)
        vertices: list[Vertex] = []
        if held:
            pushes = np.array([self.push(b.contacts[i]) for i in held])
            gain = pushes / b.masses @ pushes.T
            least = -np.linalg.pinv(gain, rcond=1e-10) @ (pushes / b.masses @ force)
            vertices = self.vertices(held, pushes, least)
            force = force + pushes.T @ least
        A = np.zeros((self.size, self.size))
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n] = force / b.masses[:, None]
        A[2 * n + 1, 2 * n + 2], A[2 * n + 2, 2 * n + 1] = -b.omega, b.omega
        self.made[modes] = A, vertices
        return A, vertices

    def limits(self, i: int) -> tuple[float, float]:
        contact = self.bodies.contacts[i]
        return (-contact.static, contact.static) if isinstance(contact, Rub) else (0.0, math.inf)

    def vertices(self, held: list[int], pushes: Floats, least: Floats) -> list[Vertex]:
        """Return for each vertex of the forces their distances from the limits, and whose."""
        one = np.zeros(self.size)
        one[2 * self.n] = 1.0
        _, values, right = np.linalg.svd(pushes.T)
        free = right[int(np.sum(values > 1e-10)) :].T  # forces that move nothing
        many = free.shape[1]
        found: list[Vertex] = []
        for chosen in itertools.combinations(range(len(held)), many):
            part = free[list(chosen)]
            if many and abs(np.linalg.det(part)) < 1e-10:
                continue
            ends = [[end for end in self.limits(held[k]) if math.isfinite(end)] for k in chosen]
            for at in itertools.product(*ends):
                forces = least
                if many:
                    lack = np.outer(at, one) - least[list(chosen)]
                    forces = least + free @ np.linalg.solve(part, lack)
                rows, of = [], []
                for k in range(len(held)):
                    low, high = self.limits(held[k])
                    if k not in chosen:
                        rows.append(forces[k] - low * one)
                        of.append(held[k])
                        if math.isfinite(high):
                            rows.append(high * one - forces[k])
                            of.append(held[k])
                found.append((np.array(rows).reshape(len(rows), self.size), of))
        return found

    def margin(self, modes: Modes, states: Floats) -> Floats:
        """Return by how much forces that hold are within their limits, at states in columns."""
        vertices = self.made_of(modes)[1]
        if not vertices:
            return np.full(states.shape[1], 1e9)
        # Beyond 1e9 nothing is near a limit, as where a contact is clamped between stops.
        return np.max([(rows @ states).min(axis=0, initial=1e9) for rows, _ in vertices], axis=0)

    def watched(self, modes: Modes) -> list[tuple[int, Floats]]:
        """Return what must stay positive beside the margin: slips and gaps, with their contact."""
        rows = []
        for i, (contact, mode) in enumerate(zip(self.bodies.contacts, modes, strict=True)):
            if isinstance(contact, Rub) and mode != 0:
                rows.append((i, mode * self.row(contact, True)))
            elif isinstance(contact, Stop) and mode == 0:
                rows.append((i, self.row(contact, False)))
        return rows

    # What comes next.

    def rests(self, y: Floats) -> list[bool]:
        """Return which contacts have no relative speed, and no gap."""
        resting = []
        for contact in self.bodies.contacts:
            still = abs(self.row(contact, True) @ y) < REST
            closed = isinstance(contact, Rub) or abs(self.row(contact, False) @ y) < REST
            resting.append(bool(still and closed))
        return resting

    def struck(self, t: float, y: Floats) -> tuple[Floats, bool]:
        """Return the state after all impacts of an instant."""
        done: set[int] = set()
        y = y.copy()
        for _ in range(20):
            hit = [
                i
                for i, contact in enumerate(self.bodies.contacts)
                if isinstance(contact, Stop)
                and abs(self.row(contact, False) @ y) < REST
                and self.row(contact, True) @ y < -REST
            ]
            if not hit:
                return y, bool(done)
            if len(hit) > 1 or done - set(hit):
                raise Unclear("impacts of one instant")
            contact = self.bodies.contacts[hit[0]]
            assert isinstance(contact, Stop)
            push = self.push(contact)
            share = push / self.bodies.masses
            approach = self.row(contact, True) @ y
            y[self.n : 2 * self.n] -= (1.0 + contact.e) * approach / (push @ share) * share
            done.add(hit[0])
            # Without restitution too, where slips bring a stop back to what has struck it.
            late = [i for i, at in zip(self.stops, self.impacts, strict=True) if t - at < SEQUENCE]
            if hit[0] in late or (late and contact.e > 0.0):
                raise Unclear("impacts of a sequence")
            self.stops.append(hit[0])
            self.impacts.append(t)
        raise Unclear("impacts of one instant")

    def put_right(self, y: Floats, resting: list[bool]) -> Floats:
        """Return a state in which what rests does so exactly."""
        some = [
            (self.row(contact, True), self.push(contact))
            for contact, on in zip(self.bodies.contacts, resting, strict=True)
            if on
        ]
        if not some:
            return y
        y = y.copy()
        rows, pushes = (np.array(each) for each in zip(*some, strict=True))
        gain = pushes / self.bodies.masses @ pushes.T
        impulse = np.linalg.pinv(gain, rcond=1e-10) @ (rows @ y)
        y[self.n : 2 * self.n] -= pushes.T @ impulse / self.bodies.masses
        return y

    def true(self, modes: Modes, resting: list[bool], y: Floats) -> bool:
        """Return whether a mode is true to itself, now and after a moment."""
        A, _ = self.made_of(modes)
        later = y + MOMENT * (A @ y) + MOMENT**2 / 2.0 * (A @ (A @ y))
        # Now too: a load that falls may be within the limits a moment after a stick it forbids.
        if self.margin(modes, np.stack([y, later], axis=1)).min() < -BORNE:
            return False
        for contact, mode, rests in zip(self.bodies.contacts, modes, resting, strict=True):
            if not rests:
                continue
            slip = float(self.row(contact, True) @ later)
            if isinstance(contact, Rub) and mode != 0 and mode * slip < -TRUE:
                return False
            if isinstance(contact, Stop) and mode == 0 and slip < -TRUE:
                return False
        return True

    def choose(self, y: Floats, before: Modes | None, fired: int, resting: list[bool]) -> Modes:
        """Return the mode after an event: of contact `fired`, or -1 where forces reach a limit."""
        choices: list[tuple[int, ...]] = []
        for i, contact in enumerate(self.bodies.contacts):
            if isinstance(contact, Stop):
                choices.append((0, 1) if resting[i] else (0,))
            elif resting[i]:
                choices.append((0, 1, -1))
            else:
                choices.append((1 if self.row(contact, True) @ y > 0.0 else -1,))
        rubs = [i for i, each in enumerate(self.bodies.contacts) if isinstance(each, Rub)]
        stuck = [i for i in rubs if before is not None and before[i] == 0 and resting[i]]
        critical = self.critical(before, y) if before is not None and fired == -1 else []
        found: list[tuple[int, int, int, Modes]] = []
        for modes in itertools.product(*choices):
            if not self.true(modes, resting, y):
                continue
            # What is at its limit slips, unless everything stays as it is with stops in its way.
            slips = not critical or any(modes[i] != 0 for i in critical)
            if not slips and any(modes[i] != 0 for i in stuck):
                continue
            spared = critical if slips else []
            moved = sum(modes[i] != 0 for i in rubs if resting[i] and i not in (*spared, fired))
            touches = sum(modes[i] for i in range(len(modes)) if i not in rubs)
            through = int(fired >= 0 and modes[fired] != 0 and fired in rubs)
            found.append((moved, through, touches, modes))
        if not found:
            raise Unclear("no mode is true to itself")
        least = min(each[:2] for each in found)
        best = sorted(each[2:] for each in found if each[:2] == least)
        slopes = [self.made_of(modes)[0] @ y for _, modes in best]
        if any(np.abs(slope - slopes[0]).max() > 1e-6 for slope in slopes):
            raise Unclear("several motions")
        return best[0][1]

    def critical(self, modes: Modes, y: Floats) -> list[int]:
        """Return which frictions hold with all they can."""
        held, vertices = self.held(modes), self.made_of(modes)[1]
        most = max(float((rows @ y).min(initial=1e9)) for rows, _ in vertices)
        full: set[int] = set()
        for rows, of in vertices:
            slack = rows @ y
            if len(rows) and slack.min() > most - 1e-7:
                full |= {k for k in held if k not in of}
                full |= {k for k, left in zip(of, slack, strict=True) if left < 1e-6}
        return [k for k in sorted(full) if isinstance(self.bodies.contacts[k], Rub)]

    # The motion.

    def follow(self, y: Floats, end: float) -> None:
        """Follow the motion from x and v at t = 0, as far as it is determined."""
        t, y = 0.0, np.concatenate([y, [1.0, 1.0, 0.0]])
        modes: Modes | None = None
        fired = -1
        try:
            for _ in range(400):
                y, hit = self.struck(t, y)
                resting = self.rests(y)
                if fired >= 0 and not hit and isinstance(self.bodies.contacts[fired], Rub):
                    resting[fired] = True
                y = self.put_right(y, resting)
                modes = self.choose(y, None if hit else modes, fired, resting)
                self.arcs.append(Arc(t, modes, self.made_of(modes)[0], y))
                t, y, fired = self.arc(t, y, modes, end)
                self.until = t
                if t >= end:
                    return
            self.why = "many events"
        except Unclear as why:
            self.why = str(why)

    def arc(self, t: float, y: Floats, modes: Modes, end: float) -> tuple[float, Floats, int]:
        """Follow one mode to its end: return time, state and what fired."""
        A, _ = self.made_of(modes)
        if modes not in self.steps:
            self.steps[modes] = expm(A * STEP)
        step = self.steps[modes]
        watched = self.watched(modes)
        rows = np.array([row for _, row in watched]).reshape(len(watched), self.size)
        begin = t
        first = expm(A * MOMENT) @ y
        states = np.empty((self.size, BLOCK + 1))
        at = t + MOMENT
        while True:
            states[:, 0] = first
            for k in range(BLOCK):
                states[:, k + 1] = step @ states[:, k]
            values = np.vstack([rows @ states, self.margin(modes, states)[None]])
            below = np.argwhere((values < -SEEN).any(axis=0))
            last = int(below[0, 0]) if len(below) else BLOCK
            self.look(values[:, : last + 1], at, end)
            if len(below):
                crossed = np.flatnonzero(values[:, last] < -SEEN)
                base = self.arcs[-1].y
                a = max(begin, at + (last - 1) * STEP)
                found = []
                for g in crossed:

                    def value(s: float, g: int = int(g), base: Floats = base) -> float:
                        state = expm(A * (s - begin)) @ base
                        if g < len(watched):
                            return float(rows[g] @ state)
                        return float(self.margin(modes, state[:, None])[0])

                    low = max(a, begin + MOMENT)
                    if value(low) <= 0.0:
                        if low > a:
                            raise Unclear("events of one moment")
                        found.append((low, int(g)))
                    else:
                        root = brentq(value, low, at + last * STEP, xtol=1e-14, rtol=1e-14)
                        found.append((float(root), int(g)))
                t, g = min(found)
                if t >= end:
                    break
                fired = watched[g][0] if g < len(watched) else -1
                if fired >= 0 and isinstance(self.bodies.contacts[fired], Stop):
                    self.clear(fired, expm(A * (t - begin)) @ base)
                return t, expm(A * (t - begin)) @ base, fired
            first = states[:, -1]
            at += BLOCK * STEP
            if at >= end:
                break
        return end, expm(A * (end - begin)) @ self.arcs[-1].y, -1

    def look(self, values: Floats, at: float, end: float) -> None:
        """Raise where something comes so near to zero that it may be crossed between looks."""
        inner = values[:, 1:-1]
        dips = (inner < values[:, :-2]) & (inner < values[:, 2:]) & (inner < CLOSE)
        dips &= np.ptp(values, axis=1)[:, None] > CLOSE
        if dips.any():
            t = at + STEP * (1 + int(np.argwhere(dips.any(axis=0))[0, 0]))
            if t < end:
                self.until = t - STEP
                raise Unclear("a graze")

    def clear(self, fired: int, y: Floats) -> None:
        """Raise where an impact is so weak that it may not be one."""
        if abs(self.row(self.bodies.contacts[fired], True) @ y) < CLOSE:
            raise Unclear("a weak impact")

    def at(self, times: Floats) -> Floats:
        """Return x and v at times, one a row."""
        starts = np.array([arc.t for arc in self.arcs])
        rows = []
        for t in times:
            arc = self.arcs[max(0, int(np.searchsorted(starts, t, side="right")) - 1)]
            rows.append((expm(arc.matrix * (t - arc.t)) @ arc.y)[: 2 * self.n])
        return np.array(rows)
