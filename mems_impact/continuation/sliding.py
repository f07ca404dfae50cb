"""Sliding bifurcations, and collisions with corners and borders.

Where two fields lead a state towards a surface H = 0, it slides or sticks there. The sliding region
ends where one of the two fields is tangent to the surface. An orbit that meets this boundary passes
one of four sliding bifurcations (di Bernardo, Kowalczyk and Nordmark 2002), by the modes in which
it arrives and departs:

===================  ==================  ==================
type                 arrives             departs
===================  ==================  ==================
grazing-sliding      the tangent field   the tangent field
crossing-sliding     the other field     the tangent field
switching-sliding    the other field     sliding
adding-sliding       sliding             sliding
===================  ==================  ==================

The second derivative of H along the tangent field, positive into its side, is positive in the first
two (a visible tangency), negative in the third, and zero in the last, where the third derivative is
negative.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.branch import OrbitEvent
from mems_impact.continuation.special_points import MAX_VANISHING_LENGTH
from mems_impact.continuation.test_functions import (
    CHATTER_ONSET,
    GRAZING,
    GUARD_TESTS,
    ClosestApproachTest,
    ContactSpeedTest,
    ModeChoiceTest,
    closest_approach,
)
from mems_impact.errors import FunctionError, OrbitError
from mems_impact.hybrid.differences import sixth_order_difference
from mems_impact.hybrid.event_loop.workspace import NONE
from mems_impact.orbits.signature import BOUNDARY

GRAZING_SLIDING, CROSSING_SLIDING, SWITCHING_SLIDING, ADDING_SLIDING = (
    "grazing-sliding",
    "crossing-sliding",
    "switching-sliding",
    "adding-sliding",
)
SURFACE_GRAZING, CORNER_COLLISION, BORDER_COLLISION = (
    "surface grazing",
    "corner collision",
    "border collision",
)
TYPE_LABELS = {
    GRAZING_SLIDING: "GS",
    CROSSING_SLIDING: "CS",
    SWITCHING_SLIDING: "SS",
    ADDING_SLIDING: "AS",
    CORNER_COLLISION: "CO",
    BORDER_COLLISION: "BC",
    SURFACE_GRAZING: "SG",
}

FUNCTION_FAILURES = (FunctionError, ArithmeticError, ValueError)
TOUCH_TESTS = (ClosestApproachTest, ContactSpeedTest)
SURFACE_MARGIN = 1e-5  # largest margin of a guard whose surface contains the point
STATE_DISTANCE = 1e-4  # of states at which modes are determined, relative to the orbit's size
DIFFERENCE_STEP = 1e-3  # of derivatives along a field, relative to the period or time scale
SLIDE_STEP = 1e-2  # along a field to states at which a mode is tested to slide, likewise
RATE_TOLERANCE = 1e-6  # of rates that are zero in a mode that slides, relative to the largest rate
TANGENT_TOLERANCE = 1e-4  # of the rate of a tangent field, relative to the other derivatives
CUBIC_TOLERANCE = 1e-2  # of its second derivative at a cubic tangency, relative to the third
EXPECTED_TANGENCIES = {
    GRAZING_SLIDING: "visible",
    CROSSING_SLIDING: "visible",
    SWITCHING_SLIDING: "invisible",
    ADDING_SLIDING: "cubic",
}


@dataclass(frozen=True)
class Tangency:
    """Derivatives of the height of a surface at the boundary of its sliding region.

    The height is the margin of the surface's guard in the mode of the tangent field, so it is
    positive on the side of that field. `tangent`, `other` and `sliding` are the modes of the
    tangent field, of the field on the other side (NONE if there is none) and of sliding.
    """

    guard: int
    tangent: int
    other: int
    sliding: int
    # First derivatives along the tangent field and along the other field (nan without).
    rates: tuple[float, float]
    second: float  # along the tangent field, as `third`
    third: float
    # "visible", "invisible" or "cubic"; empty if the first derivative is not zero, as with static
    # friction above the dynamic one.
    kind: str


@dataclass(frozen=True)
class Discontinuity:
    """A bifurcation at which an orbit meets a discontinuity of its field."""

    type: str
    guards: tuple[int, ...]  # those that meet there
    modes: tuple[int, int]  # in which the orbit arrives and departs
    time: float  # since the start of the orbit's period
    state: Floats
    tangency: Tangency | None = None  # None unless the orbit meets the boundary of a sliding region


def is_discontinuity(event: OrbitEvent) -> bool:
    """Return whether a guard is touched at a special point, or events coincide there."""
    by_impact = event.kind == GRAZING and isinstance(event.monitor, TOUCH_TESTS)
    known = by_impact or event.kind == CHATTER_ONSET
    return isinstance(event.monitor, GUARD_TESTS) and not known


def discontinuity(event: OrbitEvent) -> Discontinuity:
    """Classify a special point for which `is_discontinuity` holds.

    Raises OrbitError if its type cannot be determined.
    """
    try:
        return Junction(event).discontinuity()
    except FUNCTION_FAILURES as error:
        raise OrbitError(
            f"the type of {event.kind!r} cannot be determined: a function of the system fails near "
            f"the point ({error})",
            "define flow and margins a little beyond the guards",
        ) from error


# --- The point at which an orbit meets surfaces


@dataclass(frozen=True)
class Surface:
    """A surface with a sliding region; its height is the margin of `guard` in `mode`."""

    guard: int
    mode: int
    sliding: frozenset[int]  # the modes that slide on the surface
    # The modes that reach it, each with its side: 1 for positive height, else -1.
    free: dict[int, int]
    guards: frozenset[int]  # those that reach it, or leave it


class Junction:
    """The instant of a special point, with the modes and events of the orbit next to it.

    Segments that vanish at the point are part of it.
    """

    def __init__(self, event: OrbitEvent) -> None:
        orbit = event.solution
        self.event, self.shooting, self.point = event, orbit.shooting, orbit.point
        self.automaton, self.m = self.shooting.automaton, self.shooting.m
        self.parameters = np.asarray(orbit.problem.parameters, dtype=float)
        self.time_scale = self.shooting.variational(self.point.parameter_point).time_scale
        segments, count = self.shooting.segments, len(self.shooting.segments)
        short = self.point.ends - self.point.starts < MAX_VANISHING_LENGTH
        self.passed: tuple[int, ...] = ()
        self.codes: frozenset[int] = frozenset()
        inside = self._touch()
        if inside is not None and not short[inside[0]]:
            i, self.time, self.state = inside
            self.before = self.after = segments[i].mode
            return
        first = self._last_segment()
        while short[first]:
            first = (first - 1) % count
        passed, following = [], (first + 1) % count
        while short[following]:
            passed.append(following)
            following = (following + 1) % count
        self.passed = tuple(segments[i].mode for i in passed)
        self.codes = frozenset(segments[i].code for i in (first, *passed)) - {BOUNDARY}
        self.before, self.after = segments[first].mode, segments[following].mode
        self.time = float(self.point.ends[first])
        self.state = np.array(self.point.arcs[first].end)

    def _touch(self) -> tuple[int, float, Floats] | None:
        """Return segment, time and state of a closest approach within a segment."""
        monitor = self.event.monitor
        if not isinstance(monitor, ClosestApproachTest):
            return None
        touch = closest_approach(self.shooting, self.point, monitor.guard, monitor.segment)
        if touch is None or not touch.inside:
            return None
        state = self.point.arcs[touch.segment].touches[monitor.guard].copy()
        return touch.segment, touch.time, state

    def _last_segment(self) -> int:
        """Return a segment that ends at the point."""
        monitor = self.event.monitor
        if not isinstance(monitor, ClosestApproachTest):
            return int(monitor.segment)  # type: ignore[attr-defined]
        touch = closest_approach(self.shooting, self.point, monitor.guard, monitor.segment)
        if touch is None:
            raise OrbitError("the orbit does not touch the guard", "locate the point again")
        i = touch.segment
        middle = 0.5 * float(self.point.starts[i] + self.point.ends[i])
        return i if touch.time > middle else (i - 1) % len(self.shooting.segments)

    @cached_property
    def guards(self) -> frozenset[int]:
        """The guards that meet at the point."""
        own = getattr(self.event.monitor, "guard", NONE)
        if isinstance(self.event.monitor, ModeChoiceTest):
            own = NONE  # a margin of one of the modes, not an event
        fired = {code % self.m for code in self.codes if code < 2 * self.m}
        return frozenset(fired | {own}) - {NONE}

    # Fields and heights near the point, interpreted.

    def height(self, guard: int, mode: int, t: float, y: Floats) -> float:
        """Return the margin of a guard in a mode."""
        return float(self.automaton.margins_at(mode, t, y, self.parameters)[0][guard])

    def derivative(
        self, field: int, surface: tuple[int, int], order: int, t: float, y: Floats
    ) -> float:
        """Return a derivative of the height of a surface along the field of a mode."""
        if order == 0:
            return self.height(*surface, t, y)
        slope = self.automaton.slope_at(field, t, y, self.parameters)

        def lower(s: float) -> Any:
            return self.derivative(field, surface, order - 1, t + s, y + s * slope)

        return float(sixth_order_difference(lower, DIFFERENCE_STEP * self.time_scale))

    def gradient(self, surface: tuple[int, int]) -> Floats:
        """Return the derivative of a height by the state."""
        sizes = self.sizes
        found = np.zeros(sizes.size)
        for j in range(sizes.size):
            unit = np.zeros(sizes.size)
            unit[j] = sizes[j]

            def along(s: float, unit: Floats = unit) -> Any:
                return self.height(*surface, self.time, self.state + s * unit)

            found[j] = float(sixth_order_difference(along, STATE_DISTANCE)) / sizes[j]
        return found

    @cached_property
    def sizes(self) -> Floats:
        """Size of each component over the orbit."""
        states, _ = self.shooting.unpack(self.point.unknowns)
        arcs = self.point.arcs
        ends = np.array([arc.end for arc in arcs])
        slopes = np.array([[arc.slope_start, arc.slope_end] for arc in arcs]).reshape(
            -1, ends[0].size
        )
        largest = np.abs(np.vstack([states, ends])).max(axis=0)
        moved = self.time_scale * np.abs(slopes).max(axis=0)
        found = np.maximum(largest, 0.1 * moved)
        return np.asarray(np.where(found > 0.0, found, 1.0))

    def nearby(self, normal: Floats | None = None) -> list[Floats]:
        """Return the point and states around it, on the surface with this normal if given."""
        moves = [np.zeros(self.state.size)]
        for j in self.shooting.free:
            unit = np.zeros(self.state.size)
            unit[j] = STATE_DISTANCE * self.sizes[j]
            if normal is not None:
                unit -= normal * float(normal @ unit) / float(normal @ normal)
            moves += [unit, -unit]
        return [self.state + move for move in moves]

    # Modes next to the point.

    def modes_after(self, mode: int, guard: int) -> set[int]:
        """Return the modes after an event at the point and around it, earlier and later too."""
        aside = STATE_DISTANCE * self.time_scale
        places = [(self.time, y) for y in self.nearby()]
        places += [(self.time + move, self.state) for move in (-aside, aside)]
        return {self._mode_after(mode, guard, t, y) for t, y in places} - {NONE}

    @cached_property
    def transitions(self) -> frozenset[tuple[int, int, int]]:
        """Mode, guard and mode after it, of the transitions at the point and around it."""
        monitor = self.event.monitor
        reached = {self.before, self.after, *self.passed}
        if isinstance(monitor, ModeChoiceTest) and monitor.mode != NONE:
            reached.add(monitor.mode)
        done: set[int] = set()
        found: set[tuple[int, int, int]] = set()
        while reached - done:
            mode = min(reached - done)
            done.add(mode)
            margins, _ = self.automaton.margins_at(mode, self.time, self.state, self.parameters)
            for j, guard in enumerate(self.automaton.guards):
                if guard.records or guard.impact or abs(margins[j]) > SURFACE_MARGIN:
                    continue
                after = self.modes_after(mode, j) - {mode}
                found |= {(mode, j, into) for into in after}
                reached |= after
        return frozenset(found)

    def slides(self, mode: int, surface: tuple[int, int], modes: Iterable[int]) -> bool:
        """Return whether a mode keeps a height constant on its surface; others determine scales."""
        normal = self.gradient(surface)
        if not normal.any():
            return False
        around = [(self.time, y) for y in self.nearby(normal)]
        reach = SLIDE_STEP * self.time_scale

        def rates(field: int) -> float:
            # Along the field too: the rate of a tangent field may depend on time alone.
            slope = self.automaton.slope_at(field, self.time, self.state, self.parameters)
            along = [(self.time + s, self.state + s * slope) for s in (-reach, reach)]
            values = [self.derivative(field, surface, 1, t, y) for t, y in (*around, *along)]
            return float(np.abs(values).max())

        largest = max(rates(other) for other in modes)
        return rates(mode) <= RATE_TOLERANCE * largest

    @cached_property
    def surfaces(self) -> tuple[Surface, ...]:
        """The surfaces with sliding regions that contain the point."""
        modes = sorted({mode for one, _, other in self.transitions for mode in (one, other)})
        pairs = [
            (mode, j, into)
            for mode, j, into in sorted(self.transitions)
            if self.slides(into, (j, mode), modes)
        ]
        found: list[Surface] = []
        for mode, j, _ in pairs:
            if not any(mode in surface.free and j in surface.guards for surface in found):
                found.append(self._surface(mode, j, pairs))
        return tuple(found)

    def _surface(self, mode: int, guard: int, pairs: list[tuple[int, int, int]]) -> Surface:
        """Return the surface of a guard in a mode, from the transitions that lead to sliding."""
        sliding = {into for one, j, into in pairs if (one, j) == (mode, guard)}
        normal = self.gradient((guard, mode))
        free: dict[int, int] = {}
        guards: set[int] = set()
        # A mode that slides does not count as reaching the surface: a held body has a limit of its
        # own.
        for one, j, into in pairs:
            if into not in sliding or one in sliding:
                continue
            other = self.gradient((j, one))
            cosine = float(normal @ other) / float(np.linalg.norm(normal) * np.linalg.norm(other))
            if abs(cosine) > 1.0 - RATE_TOLERANCE:
                free[one] = 1 if cosine > 0.0 else -1
                guards.add(j)
        for one, j, into in sorted(self.transitions):
            if one in sliding and into not in sliding and j not in guards:
                if into not in free:
                    free[into] = self._side((guard, mode), one, into)
                guards.add(j)
        return Surface(guard, mode, frozenset(sliding), free, frozenset(guards))

    def _side(self, surface: tuple[int, int], sliding: int, mode: int) -> int:
        """Return the side to which a mode departs from sliding."""
        rates = [self.derivative(mode, surface, k, self.time, self.state) for k in (1, 2)]
        scale = max(
            abs(self.derivative(surface[1], surface, 1, self.time, y)) for y in self.nearby()
        )
        leading = rates[0] if abs(rates[0]) > TANGENT_TOLERANCE * scale else rates[1]
        return 1 if leading >= 0.0 else -1

    # Classification.

    def discontinuity(self) -> Discontinuity:
        """Return the bifurcation at the point."""
        switches = 2 * self.m in self.codes
        impacts = any(self.automaton.guards[j].impact for j in self.guards)
        if switches:
            return self._classified(BORDER_COLLISION)
        if not impacts:
            for surface in self.surfaces:
                if self.guards <= surface.guards:
                    return self._sliding(surface)
        if len(self.guards) > 1 and not self._parallel():
            return self._classified(CORNER_COLLISION)
        touched = isinstance(self.event.monitor, TOUCH_TESTS) and not impacts
        if touched and self.before == self.after:
            return self._classified(SURFACE_GRAZING)
        raise self._undecided("no mode slides on its surface")

    def _classified(self, kind: str, tangency: Tangency | None = None) -> Discontinuity:
        return Discontinuity(
            type=kind,
            guards=tuple(sorted(self.guards)),
            modes=(self.before, self.after),
            time=self.time,
            state=self.state,
            tangency=tangency,
        )

    def _undecided(self, reason: str) -> OrbitError:
        names = self.automaton.modes
        return OrbitError(
            f"the type of {self.event.kind!r} between the modes {names[self.before]} and "
            f"{names[self.after]} cannot be determined: {reason}",
            "compare the orbits on both sides of the point",
        )

    def _parallel(self) -> bool:
        """Return whether the guards that meet have one surface."""
        normals = [
            self.gradient((j, mode))
            for j in self.guards
            for mode in (self.before, *self.passed, self.after)
            if abs(self.height(j, mode, self.time, self.state)) < SURFACE_MARGIN
        ]
        units = [normal / np.linalg.norm(normal) for normal in normals if normal.any()]
        pairs = itertools.combinations(units, 2)
        return all(abs(float(a @ b)) > 1.0 - RATE_TOLERANCE for a, b in pairs)

    def _sliding(self, surface: Surface) -> Discontinuity:
        """Return the sliding bifurcation at the boundary of the sliding region of a surface."""
        arrives, departs = (mode in surface.sliding for mode in (self.before, self.after))
        sides = [surface.free.get(mode, 0) for mode in (self.before, self.after)]
        if arrives and departs:
            kind = ADDING_SLIDING
            left = [m for m in self.passed if m in surface.free] or [
                into for one, _, into in sorted(self.transitions)
                if one in surface.sliding and into in surface.free
            ]  # fmt: skip
            tangent = min(left, key=self._rate_of(surface), default=NONE)
        elif arrives:
            raise self._undecided("it leaves the surface, and does not reach it")
        elif departs and self._is_tangent(self.before, surface):
            # The body sticks where static friction exceeds dynamic friction.
            kind, tangent = GRAZING_SLIDING, self.before
        elif departs:
            kind = SWITCHING_SLIDING
            beyond = [mode for mode, side in surface.free.items() if side == -sides[0]]
            tangent = min(beyond, key=self._rate_of(surface), default=NONE)
        else:
            kind = GRAZING_SLIDING if self.before == self.after else CROSSING_SLIDING
            if kind == CROSSING_SLIDING and sides[0] == sides[1]:
                raise self._undecided("both lie on one side of the surface")
            tangent = self.after
        return self._classified(kind, self._tangency(surface, kind, tangent))

    def _is_tangent(self, mode: int, surface: Surface) -> bool:
        """Return whether the field of a mode is tangent to a surface."""
        margin = surface.guard, surface.mode
        first, second = (
            abs(self.derivative(mode, margin, order, self.time, self.state)) for order in (1, 2)
        )
        return first <= TANGENT_TOLERANCE * second * self.time_scale

    def _opposite(self, surface: Surface, side: int) -> int:
        """Return a mode of the field opposite to a side, outside the transitions; NONE if none."""
        normal = self.gradient((surface.guard, surface.mode))
        for mode in range(len(self.automaton.modes)):
            margin = surface.guard, mode
            if mode in surface.sliding or abs(self.height(*margin, self.time, self.state)) > (
                SURFACE_MARGIN
            ):
                continue
            if side * float(normal @ self.gradient(margin)) >= 0.0:
                continue
            if self.modes_after(mode, surface.guard) & surface.sliding:
                return mode
        return NONE

    def _mode_after(self, mode: int, guard: int, t: float, y: Floats) -> int:
        """Return the mode after an event at a state; NONE if it has none."""
        try:
            into, _ = self.automaton.state_after(mode, guard, t, y, self.parameters)
        except FUNCTION_FAILURES:
            return NONE
        return into if 0 <= into < len(self.automaton.modes) else NONE

    def _rate_of(self, surface: Surface) -> Any:
        def rate(mode: int) -> float:
            margin = surface.guard, surface.mode
            return abs(self.derivative(mode, margin, 1, self.time, self.state))

        return rate

    def _tangency(self, surface: Surface, kind: str, tangent: int) -> Tangency | None:
        """Return the derivatives along the tangent field.

        Raises OrbitError if they contradict the type, or the mode of the field is none of a side of
        the surface.
        """
        if tangent == NONE:
            return None
        if tangent not in surface.free:
            name = self.automaton.modes[tangent]
            raise self._undecided(f"the mode {name} has no guard that leads to sliding")
        margin, side = (surface.guard, surface.mode), surface.free[tangent]
        others = [mode for mode, other in surface.free.items() if other == -side]
        if self.before in others:
            beyond = self.before
        else:
            beyond = others[0] if others else self._opposite(surface, side)

        def along(mode: int, order: int) -> float:
            return side * self.derivative(mode, margin, order, self.time, self.state)

        first, second, third = (along(tangent, order) for order in (1, 2, 3))
        other = along(beyond, 1) if beyond != NONE else float("nan")
        sliding = next(
            (m for m in (self.before, self.after, *self.passed) if m in surface.sliding),
            min(surface.sliding),
        )
        expected = EXPECTED_TANGENCIES[kind]
        shape = "visible" if second > 0.0 else "invisible"
        rate = max(abs(other) if beyond != NONE else 0.0, abs(second) * self.time_scale)
        if abs(first) > TANGENT_TOLERANCE * rate:
            shape = ""  # with static above dynamic friction
        elif (
            kind == ADDING_SLIDING and abs(second) < CUBIC_TOLERANCE * abs(third) * self.time_scale
        ):
            shape = "cubic"
        if shape not in ("", expected):
            raise self._undecided(f"the tangency is {shape}, not {expected}")
        return Tangency(
            guard=surface.guard,
            tangent=tangent,
            other=beyond,
            sliding=sliding,
            rates=(first, other),
            second=second,
            third=third,
            kind=shape,
        )
