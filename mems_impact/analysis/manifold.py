"""Stable and unstable manifolds of saddle orbits and equilibria, one-dimensional, through events.

The unstable manifold is the image of a short segment along the unstable eigenvector under the
Poincaré map. Points are added where neighbours are too far apart or the curve bends (Hobson, *J.
Computational Physics* 104, 14 (1993)).

The map need not have an inverse, as through sticking contact. The stable manifold in a section of
two dimensions therefore grows without it, from the saddle outwards: on a circle around its last
point lies a point whose image is on the part that is already known (England, Krauskopf and Osinga,
*SIAM J. Applied Dynamical Systems* 3, 161 (2004)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from mems_impact._util.arrays import Floats
from mems_impact.analysis.equilibrium import Equilibrium
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.poincare_map import FixedPoint, fixed_points
from mems_impact.errors import InvalidParameter, OrbitError, RunError
from mems_impact.hybrid.state import HybridState
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result
from mems_impact.systems.state import positive, whole
from mems_impact.tables import captions
from mems_impact.tables import table as labelled

if TYPE_CHECKING:
    import pandas as pd

Kind = Literal["unstable", "stable"]
KINDS: tuple[str, ...] = get_args(Kind)

DISTANCE_RATIO = 5e-3  # default of the largest distance of neighbours, relative to the length
SHORTEST_RATIO = 1e-3  # distance below which angles are not controlled, relative to the largest
FIRST_STEP_RATIOS = (1e-2, 1e-7)  # largest and smallest length of the first segment
STRAIGHTNESS = 1e-8  # distance of the first segment from the manifold, relative to the length
JUMP_STEP = 1e-9  # step of the parameter within which a change beyond the distance is a jump
LARGEST_STEP = 0.5  # of the parameter: half an application of the map
GROWTH, SHRINKAGE = 1.6, 0.5  # factors of the step along the curve
EASY_SHARE = 0.5  # part of the limits within which the step grows

COUNTS = ("point", "half", "piece")
LENGTH_REACHED = "length"
TOO_MANY_POINTS = "max_points"
ATTRACTOR_REACHED = "attractor"
SETTLED_RATIO = 0.1  # arclength of one application of the map at an attractor, by the distance


class _Point(NamedTuple):
    """A point of a manifold: its state, coordinates in the section, and whether a piece begins."""

    at: HybridState
    position: Floats
    begins: bool


class _Half(NamedTuple):
    """One of the two halves of the manifold of a fixed point, with the reason for its end."""

    points: list[_Point]
    end: str


@dataclass(frozen=True)
class _Control:
    """Control of the points of a curve: length, largest distance and angle, number of points."""

    length: float
    distance: float
    angle: float
    max_points: int

    @property
    def shortest(self) -> float:
        """Distance below which angles are not controlled."""
        return SHORTEST_RATIO * self.distance


def _angle(one: Floats, other: Floats) -> float:
    """Return the angle between two vectors; 0 if one is zero."""
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return math.acos(min(1.0, max(-1.0, float(one @ other) / size))) if size > 0.0 else 0.0


# --- Unstable manifold


class _Image:
    """Points of one half of the unstable manifold by a continuous parameter.

    The parameter's integer part counts applications of the map, its fraction is the place within
    the first segment. Images of the last starts are kept, since neighbours share them.
    """

    def __init__(self, point: FixedPoint, vector: Floats, multiplier: float, first: float) -> None:
        self.point, self.vector, self.multiplier = point, vector, multiplier
        self.first = first

    def start(self, fraction: float) -> Floats:
        """Return the coordinates of a point of the first segment."""
        return self.point.position + self.first * self.multiplier**fraction * self.vector

    def __call__(self, parameter: float) -> HybridState:
        applications = math.floor(parameter)
        at = self.point.state(self.start(parameter - applications))
        return self.point.map.times(applications).image(at) if applications else at


def _grown(image: _Image, control: _Control) -> _Half:
    """Return the half of an unstable manifold that a first segment grows into."""
    point = image.point

    def at(parameter: float) -> _Point:
        state = image(parameter)
        return _Point(state, point.coordinates(state), False)

    points, previous = [_Point(point.instant, point.position, True), at(0.0)], 0.0
    travelled, step = image.first, LARGEST_STEP
    marks = [travelled]  # arclengths at whole parameters
    while travelled < control.length:
        if len(points) >= control.max_points:
            return _Half(points, TOO_MANY_POINTS)
        try:
            new = at(previous + step)
        except (RunError, OrbitError) as error:
            if step <= JUMP_STEP:
                return _Half(points, str(error))
            step *= SHRINKAGE
            continue
        last = points[-1]
        distance = float(np.linalg.norm(new.position - last.position))
        bend = 0.0
        if not last.begins and distance > control.shortest:
            bend = _angle(new.position - last.position, last.position - points[-2].position)
        if (distance > control.distance or bend > control.angle) and step > JUMP_STEP:
            step *= SHRINKAGE
            continue
        previous += step
        if distance > control.distance:
            new, distance, step = new._replace(begins=True), 0.0, 4.0 * JUMP_STEP
        elif distance < EASY_SHARE * control.distance and bend < EASY_SHARE * control.angle:
            step = min(step * GROWTH, LARGEST_STEP)
        points.append(new)
        travelled += distance
        if previous >= len(marks):
            marks.append(travelled)
            if travelled > 2.0 * control.distance and _settled(marks, control):
                return _Half(points, ATTRACTOR_REACHED)
    return _Half(points, LENGTH_REACHED)


def _settled(marks: list[float], control: _Control) -> bool:
    """Return whether the last two applications of the map have hardly lengthened the curve."""
    return len(marks) > 2 and marks[-1] - marks[-3] < SETTLED_RATIO * control.distance


def _first_segment(point: FixedPoint, vector: Floats, multiplier: float, length: float) -> float:
    """Return the length of a straight segment that is the manifold within `STRAIGHTNESS`."""
    first = FIRST_STEP_RATIOS[0] * length
    while first > FIRST_STEP_RATIOS[1] * length:
        try:
            end = point.map.image(point.state(point.position + first * vector))
            away = point.coordinates(end) - point.position
            across = away - vector * float(vector @ away)
            along = float(vector @ away) - multiplier * first
            straight = float(np.linalg.norm(across)) <= STRAIGHTNESS * length
            if straight and abs(along) <= 0.1 * multiplier * first:
                return first
        except (RunError, OrbitError):
            pass  # a shorter segment stays away from the event that ends the run
        first *= SHRINKAGE
    return first


# --- Stable manifold

CIRCLE_SAMPLES = 24  # of the whole circle, where the direction of the curve is unknown
ROOT_XTOL = 1e-13
OFF_CURVE_RATIO = 1e-3  # distance from the curve beyond which an image is not on it
WINDOW_RATIO = 4.0  # length of curve searched for an image, relative to its last advance
WINDOW_MARGIN = 0.25  # and this part of the largest distance
SMALLEST_STEP_RATIO = 1e-4  # of the radius, relative to the largest
BOUNDARY_RTOL = 1e-10
ERROR_REDUCTION = 1.3  # factor by which one application of the map reduces errors of the curve
MAX_APPLICATIONS = 16


class _KnownCurve:
    """The known part of a stable manifold, in pieces of cubic curves through its points."""

    def __init__(self, origin: Floats, direction: Floats, first: float) -> None:
        self.positions = [origin, origin + first * direction]
        self.lengths = [0.0, first]
        self.breaks: set[int] = set()  # numbers of chords between two pieces
        self.direction = direction

    def append(self, position: Floats, *, begins: bool = False) -> None:
        """Add a point, which may begin a new piece."""
        if begins:
            self.breaks.add(len(self.positions) - 1)
        distance = 0.0 if begins else float(np.linalg.norm(position - self.positions[-1]))
        self.positions.append(position)
        self.lengths.append(self.lengths[-1] + distance)

    def offset(
        self, position: Floats, low: float, high: float, corner: float
    ) -> tuple[float, float, float]:
        """Return signed distance, arclength and distance beyond the ends of the nearest chord.

        Only chords between the arclengths `low` and `high` are searched. Chords that meet at more
        than the angle `corner` are straight.
        """
        lengths = np.array(self.lengths)
        first = max(0, int(np.searchsorted(lengths, low, side="right")) - 1)
        last = min(len(lengths) - 1, max(first + 1, int(np.searchsorted(lengths, high)) + 1))
        nodes = np.array(self.positions[first : last + 1])
        chords = np.diff(nodes, axis=0)
        sizes = np.linalg.norm(chords, axis=1)
        sizes[[i for i in range(len(sizes)) if first + i in self.breaks]] = 0.0
        nonzero = np.flatnonzero(sizes > 0.0)
        away = position - nodes[nonzero]
        fractions = (away * chords[nonzero]).sum(axis=1) / sizes[nonzero] ** 2
        inside = np.clip(fractions, 0.0, 1.0)
        gaps = np.linalg.norm(away - inside[:, None] * chords[nonzero], axis=1)
        i = int(np.argmin(gaps))
        chord, size, part = chords[nonzero[i]], float(sizes[nonzero[i]]), float(fractions[i])
        across = float(chord[0] * away[i][1] - chord[1] * away[i][0]) / size
        number = first + int(nonzero[i])
        beyond = max(0.0, -part, part - 1.0) * size
        part = min(1.0, max(0.0, part))
        bow = size * (
            (part - 2.0 * part**2 + part**3) * self._slope(number, number, corner)
            + (part**3 - part**2) * self._slope(number + 1, number, corner)
        )
        return across - bow, self.lengths[number] + part * size, beyond

    def _slope(self, node: int, chord: int, corner: float) -> float:
        """Return the slope of the curve at a node relative to a chord."""
        along = self.positions[chord + 1] - self.positions[chord]
        tangent = self._tangent(node, chord, corner)
        size = float(along @ tangent)
        return float(along[0] * tangent[1] - along[1] * tangent[0]) / size if size > 0.0 else 0.0

    def _tangent(self, node: int, chord: int, corner: float) -> Floats:
        """Return the tangent of the parabola through a node and its neighbours."""
        along = self.positions[chord + 1] - self.positions[chord]
        if node == 0:
            return self.direction
        other = node if chord == node - 1 else node - 1
        if other in self.breaks:
            return along
        if other + 1 >= len(self.positions):  # the end: the parabola through the last three points
            if chord == 0 or chord - 1 in self.breaks:
                return along
            before = self._tangent(chord, chord, corner)
            return np.asarray(2.0 * along / np.linalg.norm(along) - before / np.linalg.norm(before))
        beside = self.positions[other + 1] - self.positions[other]
        if _angle(along, beside) > corner:
            return along
        a, b = float(np.linalg.norm(along)), float(np.linalg.norm(beside))
        if b == 0.0:
            return along
        return np.asarray(along / a * (b / (a + b)) + beside / b * (a / (a + b)))


class _SearchCircle:
    """Growth of one half of a stable manifold by circles around its last point."""

    def __init__(self, point: FixedPoint, vector: Floats, first: float, control: _Control) -> None:
        self.point, self.control = point, control
        self.curve = _KnownCurve(point.position, vector, first)
        ends = [point.state(position) for position in self.curve.positions]
        self.points = [
            _Point(point.instant, point.position, True),
            _Point(ends[1], self.curve.positions[1], False),
        ]
        self.radius = first
        self.heading = vector
        self.image = self._image(self.curve.positions[1])
        self.reached, self.rate = 0.0, 1.0  # arclength of the last image, and its advance by step
        if self.image is not None:
            self.reached = self.curve.offset(self.image, 0.0, first, control.angle)[1]

    def grow(self) -> _Half:
        """Return the half, grown to its length."""
        while self.curve.lengths[-1] < self.control.length:
            if len(self.points) >= self.control.max_points:
                return _Half(self.points, TOO_MANY_POINTS)
            if self._advance():
                continue
            if self.radius > SMALLEST_STEP_RATIO * self.control.distance:
                self.radius *= SHRINKAGE
            elif not self._pass_impact():
                return _Half(self.points, "no point nearby has its image on the curve")
        return _Half(self.points, LENGTH_REACHED)

    def _image(self, position: Floats) -> Floats | None:
        """Return the image of a point of the section; None outside, or if it leaves the section."""
        start = self.point.state(position)
        if self.point.is_outside(start):
            return None
        try:
            end = self.point.map.image(start)
        except (RunError, OrbitError):
            return None
        return self.point.coordinates(end)

    def _on_circle(self, angle: float) -> Floats:
        cosine, sine = math.cos(angle), math.sin(angle)
        x, y = self.heading
        direction = np.array([cosine * x - sine * y, sine * x + cosine * y])
        return np.asarray(self.curve.positions[-1] + self.radius * direction)

    def _offset(self, angle: float) -> tuple[float, float, float] | None:
        """Return where the image of a point on the circle lies relative to the curve."""
        image = self._image(self._on_circle(angle))
        if image is None or self.image is None:
            return None
        window = WINDOW_RATIO * self.rate * self.radius + WINDOW_MARGIN * self.control.distance
        low, high = self.reached - window, self.reached + window
        return self.curve.offset(image, low, high, self.control.angle)

    def _advance(self) -> bool:
        """Add the point on the circle whose image lies on the curve, if there is one."""
        widest = self.control.angle
        if self.radius <= self.control.shortest:
            widest = 0.5 * math.pi  # a corner
        return self._search(np.array([-widest, 0.0, widest]))

    def _search(self, angles: Floats, *, begins: bool = False) -> bool:
        offsets = [self._offset(float(angle)) for angle in angles]
        tolerance = OFF_CURVE_RATIO * self.radius
        candidates = []
        for i in range(len(angles) - 1):
            one, other = offsets[i], offsets[i + 1]
            if one is None or other is None or one[0] * other[0] > 0.0:
                continue
            angle = self._root(float(angles[i]), float(angles[i + 1]))
            if angle is None:
                continue
            offset = self._offset(angle)
            if offset is None or abs(offset[0]) > tolerance or offset[2] > tolerance:
                continue
            if offset[1] >= self.reached - tolerance:
                candidates.append((abs(angle), angle, offset[1]))
        if not candidates:
            return False
        farthest = max(candidates, key=lambda each: each[2])
        size, angle, reached = farthest if begins else min(candidates)
        position = self._on_circle(angle)
        self._append(position, reached)
        if size < EASY_SHARE * self.control.angle:
            self.radius = min(self.radius * GROWTH, self.control.distance)
        return True

    def _root(self, low: float, high: float) -> float | None:
        def value(angle: float) -> float:
            offset = self._offset(angle)
            if offset is None:
                raise OrbitError("the circle leaves the section", "")
            return offset[0]

        try:
            return float(brentq(value, low, high, xtol=ROOT_XTOL, rtol=4.0 * ROOT_XTOL))
        except (OrbitError, ValueError):
            return None

    def _append(self, position: Floats, reached: float) -> None:
        step = position - self.curve.positions[-1]
        self.heading = step / np.linalg.norm(step)
        self.curve.append(position)
        self.points.append(_Point(self.point.state(position), position, False))
        self.rate = max(0.0, reached - self.reached) / self.radius
        self.image, self.reached = self._image(position), reached

    def _pass_impact(self) -> bool:
        """Continue on the other side of an impact at the instant of the section.

        A state in contact has the same future as the state after its impact.
        """
        contact = self._in_contact()
        if contact is None:
            return False
        for other in self._partners(contact):
            image = self._image(other)
            if image is None:
                continue
            before = len(self.curve.positions), self.heading, self.image
            self.curve.append(other, begins=True)
            self.points.append(_Point(self.point.state(other), other, True))
            self.image = image
            self.radius = SMALLEST_STEP_RATIO * self.control.distance * 8.0
            angles = np.linspace(-math.pi, math.pi, CIRCLE_SAMPLES + 1)
            if self._search(angles, begins=True):
                return True
            del self.curve.positions[before[0] :], self.curve.lengths[before[0] :], self.points[-1]
            self.curve.breaks.discard(before[0] - 1)
            self.heading, self.image = before[1:]
        return False

    def _in_contact(self) -> Floats | None:
        """Return the point of the curve's continuation at which an impact guard is zero."""
        low, high = 0.0, 16.0 * self.radius
        start = self.curve.positions[-1]

        def outside(far: float) -> bool:
            return self.point.is_outside(self.point.state(start + far * self.heading))

        if not outside(high):
            return None
        while high - low > BOUNDARY_RTOL * self.control.distance:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if outside(middle) else (middle, high)
        return np.asarray(start + low * self.heading)

    def _partners(self, position: Floats) -> list[Floats]:
        """Return the states on the other side of the impact of a state in contact.

        Closing: the state after the impact. Separating: the state before it, found along the guard.
        """
        automaton, problem = self.point.map.problem.automaton, self.point.map.problem
        p = np.asarray(problem.parameters, dtype=float)
        at = self.point.state(position)
        margins, rates = self.point.margins(at)
        hits = [i for i, guard in enumerate(automaton.guards) if guard.impact]
        guard = min(hits, key=lambda i: abs(margins[i]))

        def after(x: Floats) -> Floats:
            y = self.point.state(x).y
            _, new = automaton.state_after(at.mode, guard, at.time, y, p)
            return np.asarray(new[list(self.point.components)])

        if rates[guard] < 0.0:
            return [after(position)]
        moved = [self.point.state(position + h) for h in 1e-6 * np.eye(2)]
        normal = np.array([self.point.margins(each)[0][guard] for each in moved]) - margins[guard]
        along = np.array([-normal[1], normal[0]]) / np.linalg.norm(normal)

        def closing(s: float) -> bool:
            return bool(self.point.margins(self.point.state(position + s * along))[1][guard] < 0.0)

        def missing(s: float) -> float:
            return float((after(position + s * along) - position) @ along)

        reach = np.geomspace(1e-3, 1e3, 61) * max(1e-3, float(np.abs(position).max()))
        partners: list[Floats] = []
        for sign in (1.0, -1.0):
            line = sign * reach
            values = [missing(s) if closing(s) else math.nan for s in line]
            for i in range(len(line) - 1):
                if values[i] * values[i + 1] <= 0.0:
                    s = float(brentq(missing, line[i], line[i + 1], xtol=1e-14))
                    partners.append(position + s * along)
        return partners


# --- Result


@dataclass(frozen=True, kw_only=True, eq=False)
class Manifold(Result):
    """A one-dimensional stable or unstable manifold of a saddle, as points of a section.

    Attributes
    ----------
    system : System
    kind : str
        "unstable" or "stable".
    orbit : Orbit or Equilibrium
        The saddle.
    table : DataFrame
        One row per point: ``point``, the number of the point of the orbit, from 0; ``half``, 1 or
        -1; ``piece``, counted from 0 in each half, since the map may jump; ``arclength`` from the
        saddle, without the jumps; the states; and ``mode``, if the system has several.
    ends : tuple of str
        The reason for the end of each half: "length"; "attractor", at which an unstable manifold
        accumulates; "max_points"; or the failure.

    See Also
    --------
    manifold, plot_manifold, basins

    Examples
    --------
    >>> import mems_impact as mi
    >>> def well(mode, t, y, p):
    ...     return y.v, y.x - y.x**3 - 0.2 * y.v
    >>> system = mi.System(states=("x", "v"), flow=well)
    >>> (saddle,) = mi.find_equilibria(system, guess={"x": 0.1})
    >>> found = mi.manifold(saddle, "unstable", length=0.5)
    >>> found.kind, found.ends
    ('unstable', ('length', 'length'))
    """

    system: HybridSystem = field(repr=False)
    kind: str
    orbit: Orbit | Equilibrium = field(repr=False)
    table: pd.DataFrame = field(repr=False)
    ends: tuple[str, ...]

    def __repr__(self) -> str:
        pieces = len(self.table.groupby(["point", "half", "piece"]))
        return f"Manifold({self.kind}: {len(self.table)} points, {pieces} pieces)"

    def summary(self) -> dict[str, Any]:
        """Return the kind, the saddle and the extent."""
        return {
            "system": repr(self.system),
            "kind": self.kind,
            "saddle": repr(self.orbit),
            "points": len(self.table),
            "arclength": float(self.table["arclength"].max()),
            "ends": ", ".join(self.ends),
        }


def manifold(
    orbit: Orbit | Equilibrium,
    kind: Kind = "unstable",
    *,
    length: float,
    distance: float | None = None,
    angle: float = 0.2,
    max_points: int = 5000,
) -> Manifold:
    """Compute the one-dimensional stable or unstable manifold of a saddle.

    The saddle is a fixed point of the Poincaré map: from a start of a forcing period to a later
    start, between upward crossings of the section of an autonomous system, or of an equilibrium
    over a time step. The map integrates through all events. An orbit of n periods has n points,
    each with a manifold of two halves.

    Parameters
    ----------
    orbit : Orbit or Equilibrium
    kind : {"unstable", "stable"}, optional
        The stable manifold separates the basins of attraction. It requires a section of two
        dimensions.
    length : float
        Arclength of each half. `length` and `distance` are in the units of the integration: the
        units of the system, or its typical sizes.
    distance : float, optional
        Largest distance of neighbouring points; 1/200 of the length by default.
    angle : float, optional
        Largest angle between neighbouring chords, in radians.
    max_points : int, optional
        Largest number of points of a half.

    Returns
    -------
    Manifold

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or an autonomous system has no section.
    OrbitError
        If the manifold does not have dimension 1, or the map is not differentiable at the orbit.

    See Also
    --------
    Manifold, plot_manifold, find_orbit, edge_state, basins

    Notes
    -----
    The unstable manifold consists of images of a short segment along the eigenvector (Hobson 1993).
    Where the map jumps, by an impact more or less at the instant of the section, the manifold is in
    pieces. The stable manifold grows from the saddle by the search circle of England, Krauskopf and
    Osinga (2004), which needs no inverse of the map. At an impact at the instant of the section the
    manifold continues from the state on the other side. A map without inverse may have further
    parts of the stable set.

    Examples
    --------
    >>> import mems_impact as mi
    >>> def well(mode, t, y, p):
    ...     return y.v, y.x - y.x**3 - 0.2 * y.v
    >>> system = mi.System(states=("x", "v"), flow=well)
    >>> (saddle,) = mi.find_equilibria(system, guess={"x": 0.1})
    >>> found = mi.manifold(saddle, "stable", length=1.0)
    >>> bool(found.table["arclength"].max() >= 1.0)
    True
    """
    if not isinstance(orbit, Orbit | Equilibrium):
        raise InvalidParameter("orbit", type(orbit).__name__, "an Orbit or an Equilibrium")
    if kind not in KINDS:
        raise InvalidParameter("kind", kind, f"one of {', '.join(KINDS)}")
    for name, value in (("length", length), ("distance", distance), ("angle", angle)):
        if value is not None:
            positive(name, value)
    if angle >= 1.0:
        raise InvalidParameter("angle", angle, "below 1")
    control = _Control(
        float(length),
        DISTANCE_RATIO * float(length) if distance is None else float(distance),
        float(angle),
        whole("max_points", max_points, 10),
    )
    halves: list[tuple[int, int, _Half]] = []
    for number, point in enumerate(fixed_points(orbit)):
        squared, vector, multiplier = _direction(point, kind)
        first = _first_segment(squared, vector, multiplier, control.length)
        for half in (1, -1):
            if kind == "unstable":
                grown = _grown(_Image(squared, half * vector, multiplier, first), control)
            else:
                grown = _SearchCircle(squared, half * vector, first, control).grow()
            halves.append((number, half, grown))
    return Manifold(
        system=orbit.system,
        kind=kind,
        orbit=orbit,
        table=_table(orbit.system, halves),
        ends=tuple(half.end for _, _, half in halves),
    )


def _direction(point: FixedPoint, kind: str) -> tuple[FixedPoint, Floats, float]:
    """Return the fixed point, of a power of the map if need be, with eigenvector and multiplier.

    Raises OrbitError if the manifold does not have dimension 1, or is stable in a section that does
    not have dimension 2.
    """
    values, vectors = np.linalg.eig(point.matrix)
    unstable = np.abs(values) > 1.0
    chosen = np.flatnonzero(unstable if kind == "unstable" else ~unstable)
    count = len(values)
    if len(chosen) != 1:
        side = "outside" if kind == "unstable" else "inside"
        raise OrbitError(
            f"the {kind} manifold has dimension {len(chosen)}: so many of the {count} multipliers "
            f"lie {side} the unit circle",
            "take a saddle with one such multiplier",
        )
    if kind == "stable" and count != 2:
        raise OrbitError(
            f"the section has dimension {count}: the stable manifold is computed in 2 only",
            "compute the unstable manifold",
        )
    multiplier = float(values[chosen[0]].real)
    vector = np.asarray(vectors[:, chosen[0]].real)
    vector = vector / np.linalg.norm(vector)
    vector = vector * (1.0 if vector[np.argmax(np.abs(vector))] > 0.0 else -1.0)
    if multiplier < 0.0:
        point, multiplier = point._replace(map=point.map.times(2)), multiplier**2
    if kind == "stable":
        # Errors of the curve shrink by the unstable multiplier from image to preimage.
        growth = float(np.abs(values).max()) ** (1 if values[chosen[0]].real > 0.0 else 2)
        count = math.ceil(min(MAX_APPLICATIONS, math.log(ERROR_REDUCTION) / math.log(growth)))
        if count > 1:
            point, multiplier = point._replace(map=point.map.times(count)), multiplier**count
    return point, vector, multiplier


def _table(system: HybridSystem, halves: list[tuple[int, int, _Half]]) -> pd.DataFrame:
    """Return the table of the points."""
    rows: list[tuple[int, int, int, float]] = []
    states: list[Floats] = []
    modes: list[str] = []
    for number, sign, half in halves:
        piece, arclength, last = -1, 0.0, None
        for each in half.points:
            piece += each.begins
            if last is not None and not each.begins:
                arclength += float(np.linalg.norm(each.position - last))
            last = each.position
            rows.append((number, sign, piece, arclength))
            states.append(each.at.y)
            modes.append(system.modes[each.at.mode])
    numbers: NDArray[np.float64] = np.array(rows)
    counts = {name: numbers[:, i].astype(np.int64) for i, name in enumerate(COUNTS)}
    columns: dict[str, Any] = dict(zip(system.states, np.array(states).T, strict=True))
    table = labelled(
        columns, system, user_columns={**counts, "arclength": numbers[:, 3]}, **captions(system)
    )
    if len(system.modes) > 1:
        table["mode"] = np.array(modes, dtype=object)
    return table
