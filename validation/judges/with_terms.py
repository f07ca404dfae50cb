"""The actuator with every term there is, written out in one piece: a judge of how they compose.

Written from the paper's equations, docs/equations.md and the sources of the terms, and from nothing
of `mems_impact`. All terms are always there, and do nothing where their numbers are zero; so no
equation is ever put together. What happens when is `Device`, in the form that the reference of
`validation.campaign.integrating` follows.

States: x1, v1, x2, v2, the gas of the right film and of the left one, charge and offset of the
right electrode and of the left one, what yielding stoppers have lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from validation.judges.heyoka_full import Piece, Source

Floats = NDArray[np.float64]
Values = Mapping[str, Any]
Rng = np.random.Generator

RIGHT, LEFT, RELEASE, SLIP_END, BREAK_AWAY = range(5)
NAMES = (
    *("m1", "m2", "k", "c", "d", "delta", "e", "mu_s", "mu_d", "alpha", "g"),
    *("angle", "k3", "load", "k1", "adhesion", "fringe width", "fringe length"),
    *("resistance", "parasitic", "trapped", "trapping"),
    *("stopper", "exponent", "stopper damping", "stopper depth"),
    *("films", "ambient", "face", "viscosity", "path"),
    *("yielding", "yielding exponent", "stribeck", "viscous", "creeping", "charged"),
    *("right kind", "left kind", "comb rise", "comb overlap", "wedge"),
    *(f"{name} {power}" for name in ("capacitance", "spring") for power in range(4)),
    *("clamp", "plate", "driven plate"),
)
PLACE = {name: place for place, name in enumerate(NAMES)}
M1, M2, K, C, D, DELTA, E, MU_S, MU_D, ALPHA, G = range(11)
ANGLE, K3, LOAD, K1, STICKY, FW, FL = range(11, 18)
OHM, PARASITIC, TRAPPED, TRAPPING = range(18, 22)
STOPPER, EXPONENT, LOSSY, DEEP, FILMS, AMBIENT, FACE, VISCOSITY, PATH = range(22, 31)
YIELDING, FALL, STRIBECK, VISCOUS, CREEPING, CHARGED = range(31, 37)
RIGHT_KIND, LEFT_KIND, RISE, OVERLAP, WEDGE, CURVE, SPRING = 37, 38, 39, 40, 41, 42, 46
PLATE, COMB, CURVED, WEDGED = range(4)  # kinds of electrodes
CLAMP, PRESSED, DRIVEN = 50, 51, 52
RIGHT_SOURCE, LEFT_SOURCE, END = (53 + i * len(Source._fields) for i in range(3))
STEP = 3e-4  # of differences along the flow
LAST = 1000  # terms of sums that have no end
POINTS = 9  # of a table over the position


@njit(cache=True)
def volts(p, first, t):  # type: ignore[no-untyped-def]
    """The voltage of the source whose numbers begin at `first`."""
    bias, slope, square, cube, since, a1, w1, f1, a2, w2, f2 = p[first : first + 11]
    x = t - since
    smooth = bias + x * (slope + x * (square + x * cube))
    return smooth + a1 * math.cos(w1 * t + f1) + a2 * math.cos(w2 * t + f2)


@njit(cache=True)
def _edges(gap, size):  # type: ignore[no-untyped-def]
    """Palmer's factor for a pair of edges, and its slope by the gap."""
    if size == 0.0:
        return 1.0, 0.0
    inner = math.log(2.0 * math.pi * size / gap)
    return 1.0 + gap * (1.0 + inner) / (math.pi * size), inner / (math.pi * size)


@njit(cache=True)
def _electrode(p, kind, voltage, gap, charge, offset):  # type: ignore[no-untyped-def]
    """Attraction, current and rate of the offset."""
    x = p[D] - gap
    one, one_slope = _edges(gap, p[FW])
    two, two_slope = _edges(gap, p[FL])
    capacitance = 2.0 * p[ALPHA] * one * two / gap
    growth = 2.0 * p[ALPHA] * (one * two / gap - one_slope * two - one * two_slope) / gap
    if kind == COMB:
        capacitance, growth = p[RISE] * (p[OVERLAP] + x), p[RISE]
    elif kind == CURVED:
        c0, c1, c2, c3 = p[CURVE : CURVE + 4]
        capacitance = c0 + x * (c1 + x * (c2 + x * c3))
        growth = c1 + x * (2.0 * c2 + 3.0 * x * c3)
    elif kind == WEDGED:
        gap = max(gap, 1.1 * p[WEDGE])
        capacitance = p[ALPHA] / p[WEDGE] * math.log((gap + p[WEDGE]) / (gap - p[WEDGE]))
        growth = 2.0 * p[ALPHA] / (gap**2 - p[WEDGE] ** 2)
    node, current, trapping = voltage, 0.0, 0.0
    if p[OHM] > 0.0:
        node = (charge + capacitance * offset) / (capacitance + p[PARASITIC])
        current = (voltage - node) / p[OHM]
    if p[CHARGED] > 0.0:
        node = (voltage + capacitance * offset) / (capacitance + p[PARASITIC])
    if p[TRAPPING] > 0.0:
        trapping = (p[TRAPPED] * node - offset) / p[TRAPPING]
    return 0.5 * growth * (node - offset) ** 2, current, trapping


@njit(cache=True)
def _film(p, shares, sizes, gap, closing, gas, slope):  # type: ignore[no-untyped-def]
    """Force that parts the plates; the rates of the gas are written into `slope`."""
    pressure = 0.0
    thinned = 1.0 + 9.638 * (p[PATH] / p[AMBIENT] / gap) ** 1.159
    for i in range(shares.size):
        pressure += p[AMBIENT] * shares[i] * gas[i] / gap
        time = 12.0 * p[VISCOSITY] * sizes[i] / (p[AMBIENT] * gap**2 * thinned)
        slope[i] = closing - gas[i] / time
    return p[FACE] * pressure


@njit(cache=True)
def _drag(p, speed):  # type: ignore[no-untyped-def]
    """The coefficient of friction of a frame that slips, with its sign."""
    if p[CREEPING] > 0.0:
        return p[MU_D] * math.tanh(speed / p[CREEPING])
    size = p[MU_D]
    if p[STRIBECK] > 0.0:
        size += (p[MU_S] - p[MU_D]) * math.exp(-((speed / p[STRIBECK]) ** 2))
        size += p[VISCOUS] * abs(speed)
    return size


@njit(cache=True)
def _forces(p, shares, sizes, mode, t, y, slope):  # type: ignore[no-untyped-def]
    """All forces: of the block on the frame, from outside on each, the limit of friction.

    Rates of the states of terms are written into `slope`.
    """
    n, contact = shares.size, mode // 3
    base = 4 + 2 * n
    x, v = y[2], y[3]
    if contact != 0 and p[STOPPER] == 0.0:
        x, v = (p[DELTA] if contact == 1 else -p[DELTA]), 0.0
    # A step may look far beyond a stopper.
    closest = 0.1 * (p[D] - p[DELTA])
    near, far = max(p[D] - x, closest), max(p[D] + x, closest)
    right, left = volts(p, RIGHT_SOURCE, t), volts(p, LEFT_SOURCE, t)
    pull, slope[base], slope[base + 1] = _electrode(
        p, p[RIGHT_KIND], right, near, y[base], y[base + 1]
    )
    back, slope[base + 2], slope[base + 3] = _electrode(
        p, p[LEFT_KIND], left, far, y[base + 2], y[base + 3]
    )
    pull -= back
    on_frame = p[K] * x + p[C] * v - pull + p[K3] * x**3
    if p[SPRING + 1] != 0.0:
        s0, s1, s2, s3 = p[SPRING : SPRING + 4]
        on_frame += s0 + x * (s1 + x * (s2 + x * s3)) - p[K] * x
    if p[FILMS] > 0.0:
        on_frame += _film(p, shares, sizes, near, v, y[4 : 4 + n], slope[4 : 4 + n])
    if p[FILMS] > 1.0:
        on_frame -= _film(p, shares, sizes, far, -v, y[4 + n : base], slope[4 + n : base])
    if contact != 0 and p[STOPPER] > 0.0:
        side = 1.0 if contact == 1 else -1.0
        depth = side * x - p[DELTA]
        spring = p[STOPPER] * p[DEEP] * (max(depth, 0.0) / p[DEEP]) ** p[EXPONENT]
        push = spring * max(1.0 + 1.5 * p[LOSSY] * side * v, 0.0)
        slope[base + 4] = (push - spring) * side * v
        on_frame += side * (push - p[STICKY])
    weight = p[G] * math.sin(p[ANGLE])
    frame = -p[M1] * weight - p[LOAD] - p[K1] * y[0]
    normal = (p[M1] + p[M2]) * p[G] * math.cos(p[ANGLE]) + p[CLAMP]
    normal += p[PRESSED] + p[DRIVEN] * right * right
    return on_frame, frame, -p[M2] * weight, normal


@njit(cache=True)
def _flow(p, shares, sizes, mode, t, y, slope):  # type: ignore[no-untyped-def]
    slope[:] = 0.0
    on_frame, frame, block, normal = _forces(p, shares, sizes, mode, t, y, slope)
    friction, contact = mode % 3, mode // 3
    way = 1.0 if friction == 1 else (-1.0 if friction == 2 else 0.0)
    drag = way * _drag(p, way * y[1]) * normal
    held = contact != 0 and p[STOPPER] == 0.0
    a1 = 0.0
    if friction != 0:
        slope[0] = y[1]
        pushed, mass = (block, p[M1] + p[M2]) if held else (on_frame, p[M1])
        a1 = (frame + pushed - drag) / mass
    slope[1] = a1
    if not held:
        slope[2] = y[3]
        slope[3] = (block - on_frame) / p[M2] - a1


@njit(cache=True)
def _values(p, shares, sizes, mode, t, y, slope, out):  # type: ignore[no-untyped-def]
    """All margins of a mode; infinite where there is none."""
    out[:] = math.inf
    friction, contact = mode % 3, mode // 3
    rigid = p[STOPPER] == 0.0
    on_frame, frame, block, normal = _forces(p, shares, sizes, mode, t, y, slope)
    side = 1.0 if contact == 1 else -1.0
    way = 1.0 if friction == 1 else (-1.0 if friction == 2 else 0.0)
    if contact == 0:
        out[RIGHT] = p[DELTA] - y[2]
        out[LEFT] = p[DELTA] + y[2]
    elif rigid:
        shared = 0.0
        if friction != 0:
            shared = (frame + block - way * _drag(p, way * y[1]) * normal) / (p[M1] + p[M2])
        out[RELEASE] = side * (block - on_frame - p[M2] * shared) + p[STICKY]
    else:
        out[RELEASE] = side * y[2] - p[DELTA]
    if friction != 0:
        out[SLIP_END] = way * y[1]
    else:
        push = frame + (block if contact != 0 and rigid else on_frame)
        out[BREAK_AWAY] = p[MU_S] * normal - abs(push)


@njit(cache=True)
def _margins(p, shares, sizes, mode, times, states, values, rates):  # type: ignore[no-untyped-def]
    slope, spare = np.empty(states.shape[1]), np.empty(states.shape[1])
    out = np.empty(5)
    for row in range(times.size):
        t, y = times[row], states[row]
        _values(p, shares, sizes, mode, t, y, spare, values[row])
        _flow(p, shares, sizes, mode, t, y, slope)
        rates[row] = 0.0
        for point in range(4):
            size = 1.0 if point < 2 else 2.0
            sign = 1.0 if point % 2 == 0 else -1.0
            h = sign * size * STEP
            _values(p, shares, sizes, mode, t + h, y + h * slope, spare, out)
            for i in range(5):
                if values[row, i] < math.inf:
                    rates[row, i] += sign * (8.0 if size == 1.0 else -1.0) * out[i] / 12.0 / STEP


class Device:
    """An actuator with terms under voltages in pieces; `enter` makes one the present one.

    Parameters
    ----------
    device : mapping
        The paper's parameters by name.
    terms : mapping of str to mapping
        The numbers of each term.
    pieces : callable
        ``pieces(t)``, what pulls from then on.
    """

    order = np.arange(5.0)
    stopped = -1  # there is no such mode

    def __init__(
        self, device: Values, terms: Mapping[str, Values], pieces: Callable[[float], Piece]
    ) -> None:
        unknown = {name for name in terms if name not in TERMS or TERMS[name].places is None}
        if unknown:
            raise NotImplementedError(f"no equations of {', '.join(sorted(unknown))}")
        p = np.zeros(END)
        for name, value in device.items():
            p[PLACE[name]] = value
        self.shares = self.sizes = np.zeros(0)
        self.table: CubicHermiteSpline | None = None
        for name, values in terms.items():
            if name == "squeeze_film":
                self.shares, self.sizes = compartments(**values)
                p[FACE] = values["length"] * values["width"]
                p[FILMS] = 2.0 if values["sides"] == "both" else 1.0
            if name == "clamp_electrode":
                per_square = 0.5 * values["permittivity"] * values["area"] / values["gap"] ** 2
                p[PRESSED] = per_square * values["voltage"] ** 2
                p[DRIVEN] = per_square * (values["follows"] == "right")
            if name == "charge_drive":
                p[CHARGED] = 1.0
            if name == "tabulated_restitution":
                self.table = table(**values)
            if name in KINDS:
                for side, kind in (("right", RIGHT_KIND), ("left", LEFT_KIND)):
                    p[kind] = KINDS[name] * (values["sides"] in (side, "both"))
            if name == "comb_drive":
                area = values["fingers"] * values["thickness"] * values["permittivity"]
                p[RISE] = 2.0 * area / values["gap"]
            if name == "tilted_plate":
                p[WEDGE] = 0.5 * values["length"] * abs(values["angle"])
            for column, first in (("capacitances", CURVE), ("forces", SPRING)):
                if column in values:  # tables of the campaign are those of cubic polynomials
                    p[first : first + 4] = np.polyfit(values["positions"], values[column], 3)[::-1]
            for field, place in (TERMS[name].places or {}).items():
                if values.get(field) is not None:
                    p[PLACE[place]] = values[field]
        self.p, self.pieces = p, pieces
        self.enter(0.0)
        self.impact = np.array([p[STOPPER] == 0.0] * 2 + [False] * 3)
        n = len(self.shares)
        films = [f"{side}film_{i + 1}" for side in ("", "left_") for i in range(n)]
        electrodes = [f"{side}{name}" for side in ("", "left_") for name in ("charge", "offset")]
        self.states = ("x1", "v1", "x2", "v2", *films, *electrodes, "contact_loss")

    def enter(self, t: float) -> float:
        """Take the voltages of this time from now on; return how long they hold."""
        piece = self.pieces(t)
        self.p[RIGHT_SOURCE:LEFT_SOURCE] = piece.right
        self.p[LEFT_SOURCE:END] = piece.left
        return piece.end

    def flow(self, mode: int, t: float, y: Floats) -> Floats:
        """Return the time derivative of the state."""
        slope = np.empty(y.size)
        _flow(self.p, self.shares, self.sizes, mode, t, y, slope)
        return slope

    def margins(self, mode: int, t: Any, y: Floats) -> tuple[Floats, Floats]:
        """Return margins and rates of one state or many."""
        states = np.ascontiguousarray(y.reshape(-1, len(self.states)))
        values, rates = np.empty((2, len(states), 5))
        times = np.ravel(np.asarray(t, dtype=float))
        _margins(self.p, self.shares, self.sizes, mode, times, states, values, rates)
        return (values[0], rates[0]) if y.ndim == 1 else (values, rates)

    def fire(self, mode: int, guard: int, t: float, y: Floats) -> tuple[int, Floats]:
        """Return mode and state after a transition."""
        p, y = self.p, y.copy()
        if guard in (RIGHT, LEFT):
            y[2] = p[DELTA] if guard == RIGHT else -p[DELTA]
            if p[STOPPER] > 0.0:
                return self._sliding(1 if guard == RIGHT else 2, t, y), y
            e = self.restitution(guard, abs(float(y[3])))
            y[1] += (1.0 + e) * p[M2] * y[3] / (p[M1] + p[M2])
            y[3] *= -e
            return self.settled(t, y), y
        if guard == RELEASE:
            y[2] = p[DELTA] if mode // 3 == 1 else -p[DELTA]
            return self._sliding(0, t, y), y
        y[1] = 0.0
        if guard == SLIP_END:
            # The load on a rigid stopper jumps, since nothing brakes the frame any more.
            yields = p[STOPPER] > 0.0
            return self._sliding(mode // 3, t, y) if yields else self.settled(t, y), y
        return 3 * (mode // 3) + (1 if self._push(mode, t, y) >= 0.0 else 2), y

    def settled(self, t: float, y: Floats) -> int:
        """Return the mode of a state."""
        p, side = self.p, 1 if y[2] > 0.0 else 2
        beyond = abs(y[2]) - p[DELTA]
        if p[STOPPER] > 0.0:
            into = y[3] * y[2] > 0.0
            return self._sliding(side if beyond > 0.0 or (beyond == 0.0 and into) else 0, t, y)
        if y[3] == 0.0 and beyond >= 0.0:
            mode = self._sliding(side, t, y)
            if self.margins(mode, t, y)[0][RELEASE] > 0.0:
                return mode
        return self._sliding(0, t, y)

    def _sliding(self, contact: int, t: float, y: Floats) -> int:
        """Return the mode of this contact in which the frame moves, or is held."""
        if y[1] != 0.0:
            return 3 * contact + (1 if y[1] > 0.0 else 2)
        sticks = self.p[CREEPING] == 0.0
        if sticks and self.margins(3 * contact, t, y)[0][BREAK_AWAY] >= 0.0:
            return 3 * contact
        return 3 * contact + (1 if self._push(3 * contact, t, y) >= 0.0 else 2)

    def _push(self, mode: int, t: float, y: Floats) -> float:
        """Return what would set the frame in motion."""
        spare = np.empty(y.size)
        inner, frame, block, _ = _forces(self.p, self.shares, self.sizes, mode, t, y, spare)
        return float(frame + (block if mode // 3 and self.p[STOPPER] == 0.0 else inner))

    def contact(self, mode: int, guard: int, t: float, y: Floats) -> Floats:
        """Return the state after an impact without rebound."""
        raise NotImplementedError

    def restitution(self, guard: int, speed: float = 0.0) -> float:
        """Return the restitution of an impact."""
        if self.table is not None:
            first, last = self.table.x[[0, -1]]
            return float(self.table(min(max(speed, first), last)))
        p = self.p
        fallen = 1.0 + (speed / p[YIELDING]) ** 2 if p[YIELDING] > 0.0 else 1.0
        return float(p[E] / fallen ** (0.5 * p[FALL]))


def decades(rng: Rng, low: float, high: float) -> float:
    return float(10.0 ** rng.uniform(low, high))


def random_film(rng: Rng, p: Values) -> dict[str, Any]:
    length = rng.uniform(0.3, 1.5)
    width = length * rng.uniform(0.2, 1.0)
    pressure = decades(rng, -1.5, 0.5)
    knudsen = float(rng.choice([0.0, decades(rng, -3.0, 0.3)]))
    slowest = 1.0 / (math.pi**2 * (1.0 / length**2 + 1.0 / width**2))
    thinned = 1.0 + 9.638 * knudsen**1.159
    viscosity = pressure * p["d"] ** 2 * thinned / (12.0 * slowest * decades(rng, -0.7, 0.9))
    return {
        "length": length,
        "width": width,
        "pressure": pressure,
        "viscosity": viscosity,
        "free_path_pressure": knudsen * pressure * p["d"],
        "sides": str(rng.choice(["right", "both"])),
        "modes": int(rng.choice([1, 2], p=[0.8, 0.2])),
    }


def random_stopper(rng: Rng, p: Values) -> dict[str, Any]:
    return {
        "stiffness": p["k"] * decades(rng, 2.0, 4.0),
        "exponent": float(rng.choice([1.0, 1.5, rng.uniform(1.0, 2.0)])),
        "damping": rng.uniform(0.0, 1.0),
        "depth": 0.1 * p["delta"],
    }


def random_resistance(rng: Rng, p: Values) -> dict[str, Any]:
    own = 2.0 * p["alpha"] / p["d"]
    parasitic = float(rng.choice([0.0, rng.uniform(0.0, 2.0)])) * own
    return {"resistance": decades(rng, -1.3, 1.0) / own, "parasitic_capacitance": parasitic}


def random_fringing(rng: Rng, p: Values) -> dict[str, Any]:
    least = 2.0 * (p["d"] + p["delta"])
    found = {"width": least * rng.uniform(1.01, 4.0)}
    if rng.random() < 0.5:
        found["length"] = least * rng.uniform(1.01, 4.0)
    return found


def random_table(rng: Rng, p: Values) -> dict[str, Any]:
    count = int(rng.integers(2, 6))
    speeds = p["delta"] * (0.02 + np.cumsum(rng.uniform(0.05, 0.6, count)))
    values = rng.uniform(0.1, 0.95, count)
    return {"speeds": tuple(speeds.tolist()), "values": tuple(values.tolist())}


def random_sides(rng: Rng) -> str:
    return str(rng.choice(["both", "right", "left"]))


def random_comb(rng: Rng, p: Values) -> dict[str, Any]:
    gap, thickness = rng.uniform(0.1, 1.0, 2)
    return {
        "fingers": float(rng.integers(1, 9)),
        "gap": gap,
        "thickness": thickness,
        "overlap": p["d"] * rng.uniform(1.0, 2.0),
        "permittivity": p["alpha"] * decades(rng, -1.0, 0.5) * gap / thickness,
        "sides": random_sides(rng),
    }


def random_points(rng: Rng, p: Values) -> Floats:
    points: Floats = p["d"] * np.linspace(-1.0, 1.0, POINTS) + rng.uniform(-0.05, 0.05, POINTS)
    return points


def random_capacitances(rng: Rng, p: Values) -> dict[str, Any]:
    x = random_points(rng, p)
    curve = 1.0 + rng.uniform(0.3, 0.5) * x + rng.uniform(-0.05, 0.1) * x**2 + 0.02 * x**3
    values = 2.0 * p["alpha"] / p["d"] * curve
    return {
        "positions": tuple(x.tolist()),
        "capacitances": tuple(values.tolist()),
        "sides": random_sides(rng),
    }


def random_forces(rng: Rng, p: Values) -> dict[str, Any]:
    x = random_points(rng, p)
    forces = p["k"] * (0.02 + x + rng.uniform(-0.1, 0.1) * x**2 + rng.uniform(-0.2, 0.5) * x**3)
    return {"positions": tuple(x.tolist()), "forces": tuple(forces.tolist())}


def random_tilted_plate(rng: Rng, p: Values) -> dict[str, Any]:
    length, share = rng.uniform(1.0, 9.0), rng.uniform(-0.3, 0.3)
    angle = 2.0 * share * (p["d"] - p["delta"]) / length
    return {"angle": angle, "length": length, "sides": random_sides(rng)}


def random_clamp_electrode(rng: Rng, p: Values) -> dict[str, Any]:
    follows = str(rng.choice(["nothing", "right"]))
    return {
        "area": decades(rng, 1.0, 2.5),
        "gap": rng.uniform(0.3, 1.0),
        "permittivity": rng.uniform(0.5, 2.0),
        "voltage": rng.uniform(0.0, 0.5) if follows == "nothing" else 0.0,
        "follows": follows,
    }


class JudgedTerm(NamedTuple):
    """A term and its equations.

    Attributes
    ----------
    draw : callable
        ``draw(rng, p)``, random values: dimensionless, for a device whose k, m2 and d are of order
        one.
    places : mapping of str to str or None
        The numbers above that its fields are; None of a term that changes the source only.
    """

    draw: Callable[[Rng, Values], dict[str, Any]]
    places: Mapping[str, str] | None


TERMS = {
    "tilt": JudgedTerm(lambda rng, p: {"angle": rng.uniform(-0.3, 0.3)}, {"angle": "angle"}),
    "cubic_stiffness": JudgedTerm(lambda rng, p: {"k3": rng.uniform(-0.5, 2.0)}, {"k3": "k3"}),
    "frame_force": JudgedTerm(
        lambda rng, p: {"force": p["mu_s"] * (p["m1"] + p["m2"]) * p["g"] * rng.uniform(-0.8, 0.8)},
        {"force": "load"},
    ),
    "frame_spring": JudgedTerm(lambda rng, p: {"k1": decades(rng, -2.0, 0.5)}, {"k1": "k1"}),
    "squeeze_film": JudgedTerm(
        random_film, {"pressure": "ambient", "viscosity": "viscosity", "free_path_pressure": "path"}
    ),
    "series_resistance": JudgedTerm(
        random_resistance, {"resistance": "resistance", "parasitic_capacitance": "parasitic"}
    ),
    "charge_drive": JudgedTerm(
        lambda rng, p: {
            "parasitic_capacitance": random_resistance(rng, p)["parasitic_capacitance"]
        },
        {"parasitic_capacitance": "parasitic"},
    ),
    "fringing": JudgedTerm(random_fringing, {"width": "fringe width", "length": "fringe length"}),
    "dielectric_charging": JudgedTerm(
        lambda rng, p: {
            "share": rng.uniform(-0.5, 0.9),
            "time": decades(rng, 0.0, 2.0),
        },
        {"share": "trapped", "time": "trapping"},
    ),
    "adhesion": JudgedTerm(
        lambda rng, p: {"force": p["k"] * p["delta"] * decades(rng, -2.0, -0.1)},
        {"force": "adhesion"},
    ),
    "compliant_stopper": JudgedTerm(
        random_stopper,
        {
            "stiffness": "stopper",
            "exponent": "exponent",
            "damping": "stopper damping",
            "depth": "stopper depth",
        },
    ),
    "power_law_restitution": JudgedTerm(
        lambda rng, p: {
            "speed": p["delta"] * decades(rng, -1.5, 0.5),
            "exponent": rng.uniform(0.0, 1.0),
        },
        {"speed": "yielding", "exponent": "yielding exponent"},
    ),
    "comb_drive": JudgedTerm(random_comb, {"overlap": "comb overlap"}),
    "tabulated_capacitance": JudgedTerm(random_capacitances, {}),
    "tabulated_restitution": JudgedTerm(random_table, {}),
    "tabulated_spring": JudgedTerm(random_forces, {}),
    "tilted_plate": JudgedTerm(random_tilted_plate, {}),
    "stribeck_friction": JudgedTerm(
        lambda rng, p: {
            "speed": decades(rng, -2.0, 0.0),
            "viscous": float(rng.choice([0.0, decades(rng, -3.0, -1.0)])),
        },
        {"speed": "stribeck", "viscous": "viscous"},
    ),
    "regularized_friction": JudgedTerm(
        lambda rng, p: {
            "width": p["mu_d"] * (1.0 + p["m2"] / p["m1"]) * p["g"] / decades(rng, 0.5, 2.0)
        },
        {"width": "creeping"},
    ),
    "clamp": JudgedTerm(
        lambda rng, p: {"force": (p["m1"] + p["m2"]) * p["g"] * rng.uniform(0.0, 2.0)},
        {"force": "clamp"},
    ),
    "clamp_electrode": JudgedTerm(random_clamp_electrode, {}),
    "slew_rate": JudgedTerm(lambda rng, p: {"rate": decades(rng, -1.0, 1.0)}, None),
}
"""All terms."""

KINDS = {"comb_drive": COMB, "tabulated_capacitance": CURVED, "tilted_plate": WEDGED}


def table(speeds: tuple[float, ...], values: tuple[float, ...]) -> CubicHermiteSpline:
    """Return a monotone cubic through a table, which ends with the slope 0."""
    slopes = PchipInterpolator(speeds, values).derivative()(speeds)
    slopes[[0, -1]] = 0.0
    return CubicHermiteSpline(speeds, values, slopes)


def compartments(length: float, width: float, modes: int, **_: Any) -> tuple[Floats, Floats]:
    """Return shares and sizes of the parts of a film, by the sums of Blech's series themselves."""
    odd = np.arange(1.0, 40.0 * LAST, 2.0)

    def part(k: Floats | float, l: Floats | float) -> tuple[Any, Any]:  # noqa: E741
        share = 64.0 / (math.pi**4 * (k * l) ** 2)
        return share, share / (math.pi**2 * ((k / length) ** 2 + (l / width) ** 2))

    total, shares, weights = np.zeros(2), [], []
    for row in range(modes):
        all_of_row = np.array([each.sum() for each in part(odd, 2.0 * row + 1.0)])
        all_of_row[0] = 8.0 / (math.pi * (2.0 * row + 1.0)) ** 2
        total += all_of_row
        for along in range(modes - row):
            one = np.array(part(2.0 * along + 1.0, 2.0 * row + 1.0))
            all_of_row = all_of_row - one
            shares.append(one[0])
            weights.append(one[1])
        shares.append(all_of_row[0])
        weights.append(all_of_row[1])
    k, l = np.meshgrid(odd[:LAST], odd[modes:LAST], indexing="ij")  # noqa: E741
    shares.append(1.0 - total[0])
    weights.append(part(k, l)[1].sum())
    found = np.array(shares)
    return found, np.array(weights) / found
