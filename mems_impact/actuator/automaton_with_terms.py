"""The automaton of a device with optional terms.

Sums and products of functions are nested functions, each of which calls the next, so that numba
compiles plain calls.

With compliant stoppers, the modes "right" and "left" are contacts in which the force increases with
the depth; impacts reset no velocities.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import accumulate, product
from typing import Any, NamedTuple

from mems_impact.actuator import equations as eq
from mems_impact.actuator import impact_law
from mems_impact.actuator.automaton import (
    BREAK_AWAY,
    COUNT,
    FREE,
    GUARDS,
    LEFT,
    LEFT_IMPACT,
    MODES,
    RELEASE,
    RIGHT,
    RIGHT_IMPACT,
    SLIP_END,
    STATES,
    STUCK,
    V1,
    V2,
    X1,
    X2,
    direction_of,
    friction_towards,
    mode_of,
    side_of,
)
from mems_impact.actuator.terms.base import (
    Electrode,
    Function,
    ParameterIndices,
    RateLimit,
    TermContribution,
    TermKind,
)
from mems_impact.hybrid.automaton import Automaton, Guard

__all__ = ["Model", "compose", "composed_automaton", "layout"]

# --- Equations of an actuator with terms

SCRATCH_ARRAYS = 2  # arrays of the size of the state, between the numbers of terms and drive


@dataclass(frozen=True)
class ArrayLayout:
    """Layout of the arrays of parameters and states.

    Attributes
    ----------
    states : tuple of str
    terms : tuple of ParameterIndices
        Indices of each term, without those at electrodes.
    electrodes : tuple of tuple of ParameterIndices
        Indices of each term at each electrode.
    scratch, drive : int
        First indices of the scratch arrays and of the numbers of the drive in ``p``.
    """

    states: tuple[str, ...]
    terms: tuple[ParameterIndices, ...]
    electrodes: tuple[tuple[ParameterIndices, ...], ...]
    scratch: int
    drive: int


def layout(kinds: Sequence[TermKind], electrodes: int) -> ArrayLayout:
    """Return the layout; the states of a left electrode have the names ``left_...``."""
    states = list(STATES)

    def placed(names: Sequence[str], prefix: str = "") -> dict[str, int]:
        first = len(states)
        states.extend(prefix + name for name in names)
        return {name: first + i for i, name in enumerate(names)}

    firsts = list(accumulate((kind.length for kind in kinds), initial=eq.DRIVE))
    terms = tuple(
        kind.at(first, placed(kind.term.states(kind.shape)))
        for kind, first in zip(kinds, firsts, strict=False)
    )
    sides = tuple(
        tuple(
            kind.at(first, placed(kind.term.electrode_states(kind.shape), prefix))
            for kind, first in zip(kinds, firsts, strict=False)
        )
        for prefix in ("", "left_")[:electrodes]
    )
    scratch = firsts[-1]
    return ArrayLayout(tuple(states), terms, sides, scratch, scratch + SCRATCH_ARRAYS * len(states))


@dataclass(frozen=True)
class Model:
    """An actuator with terms, as functions for numba; see `mems_impact.actuator.terms.base`.

    Attributes
    ----------
    layout : ArrayLayout
    contributions : tuple of TermContribution
        In the order of the terms.
    electrodes : tuple of Electrode
        The right electrode, and the left one if present.
    pull : callable
        ``pull(v, w, y, p)``, the force of the electrodes, positive to the right, for the voltages v
        of the right and w of the left one.
    force, on_frame, on_block : callable
        ``force(y, p)`` of the terms.
    static_limit : callable
        ``static_limit(p)``
    sliding_friction : callable
        ``sliding_friction(direction, v1, p)``
    restitution : callable
        ``restitution(speed, p)``
    adhesion : callable
        ``adhesion(p)``
    stopper : callable or None
        ``stopper(depth, rate, p)``; None for rigid stoppers.
    stopper_slopes : callable
        ``stopper_slopes(depth, rate, p)``, its derivatives by depth and rate.
    rates : callable
        ``rates(v, w, y, p, dy)`` writes the derivatives of the states of the terms.
    limits : tuple of LimitedState
        States at electrodes whose rates are limited.
    sticks : bool
    cyclic : tuple of int
        Indices of the states that no function reads.
    """

    layout: ArrayLayout
    contributions: tuple[TermContribution, ...]
    electrodes: tuple[Electrode, ...]
    pull: Function
    force: Function
    on_frame: Function
    on_block: Function
    static_limit: Function
    sliding_friction: Function
    restitution: Function
    adhesion: Function
    stopper: Function | None
    stopper_slopes: Callable[..., tuple[float, float]]
    rates: Function
    limits: tuple[LimitedState, ...]
    sticks: bool
    cyclic: tuple[int, ...]


class LimitedState(NamedTuple):
    """A state at an electrode with a limited rate.

    Attributes
    ----------
    place : int
        Index of the state.
    side : str
        "" for the right electrode, "left " for the left one.
    limit : RateLimit
        With ``rate(v, w, y, p)``.
    """

    place: int
    side: str
    limit: RateLimit


@cache
def compose(kinds: tuple[TermKind, ...], electrodes: int) -> Model:
    """Return the equations of an actuator with terms and one or two electrodes."""
    places = layout(kinds, electrodes)
    parts = tuple(
        kind.term.contribution(at, kind.shape) for kind, at in zip(kinds, places.terms, strict=True)
    )
    ends = tuple(
        electrode_of(kinds, own, side)
        for own, side in zip(places.electrodes, (1, -1), strict=False)
    )
    normal = product_of([part.normal for part in parts if part.normal])
    return Model(
        layout=places,
        contributions=parts,
        electrodes=ends,
        pull=pull_of(ends),
        force=total_of([part.force for part in parts if part.force]),
        on_frame=total_of([part.on_frame for part in parts if part.on_frame]),
        on_block=total_of([part.on_block for part in parts if part.on_block]),
        static_limit=limit_of(normal),
        sliding_friction=friction_of(override(parts, "friction") or eq.mu_d, normal),
        restitution=override(parts, "restitution") or impact_law.restitution,
        adhesion=override(parts, "adhesion") or eq.no_adhesion,
        stopper=override(parts, "stopper"),
        stopper_slopes=override(parts, "stopper_slopes") or eq.no_slopes,
        rates=all_rates(kinds, places, parts, ends),
        limits=rate_limits(kinds, places, ends),
        sticks=all(part.sticks for part in parts),
        cyclic=cyclic_of(parts, places),
    )


def cyclic_of(parts: Sequence[TermContribution], places: ArrayLayout) -> tuple[int, ...]:
    """Return the indices of the states that no function reads: usually x1, and sums of terms."""
    frame = () if any(part.places_frame for part in parts) else (X1,)
    sums = (at.y[each] for part, at in zip(parts, places.terms, strict=True) for each in part.sums)
    return (*frame, *sums)


def override(parts: Sequence[TermContribution], name: str) -> Any:
    """Return the function `name` of the term that provides it; None without such a term."""
    found = [each for part in parts if (each := getattr(part, name))]
    return found[-1] if found else None


def total_of(functions: Sequence[Function]) -> Function:
    """Return the sum of functions ``f(y, p)``."""
    if not functions:

        def nothing(y, p):  # type: ignore[no-untyped-def]
            return 0.0

        return nothing
    if len(functions) == 1:
        return functions[0]
    first, rest = functions[0], total_of(functions[1:])

    def both(y, p):  # type: ignore[no-untyped-def]
        return first(y, p) + rest(y, p)

    return both


def product_of(functions: Sequence[Function]) -> Function:
    """Return the product of functions ``f(p)``."""
    if not functions:

        def one(p):  # type: ignore[no-untyped-def]
            return 1.0

        return one
    first, rest = functions[0], product_of(functions[1:])

    def both(p):  # type: ignore[no-untyped-def]
        return first(p) * rest(p)

    return both


def limit_of(normal: Function) -> Function:
    """Return the limit of static friction."""

    def static_limit(p):  # type: ignore[no-untyped-def]
        return eq.static_limit(p) * normal(p)

    return static_limit


def friction_of(coefficient: Function, normal: Function) -> Function:
    """Return the friction force on a slipping frame."""

    def sliding_friction(direction, v1, p):  # type: ignore[no-untyped-def]
        weight = (p[eq.M1] + p[eq.M2]) * p[eq.G] * normal(p)
        return direction * coefficient(direction * v1, p) * weight

    return sliding_friction


def electrode_of(
    kinds: tuple[TermKind, ...], places: Sequence[ParameterIndices], side: int
) -> Electrode:
    """Return the electrode on `side` as modified by all terms."""

    def node(v, x, y, p):  # type: ignore[no-untyped-def]
        return v

    def offset(y, p):  # type: ignore[no-untyped-def]
        return 0.0

    electrode = Electrode(eq.capacitance, eq.capacitance_slope, node, offset, side)
    ordered = sorted(zip(kinds, places, strict=True), key=lambda each: each[0].term.layer)
    for kind, at in ordered:
        if kind.term.instead == "electrode" and not kind.term.acts_at(kind.shape, side):
            continue
        electrode = kind.term.electrode(at, kind.shape, electrode)
    return electrode


def attraction_of(electrode: Electrode) -> Function:
    """Return the attractive force of an electrode."""
    slope, node, offset = electrode.slope, electrode.node, electrode.offset

    def attraction(v, x, y, p):  # type: ignore[no-untyped-def]
        across = node(v, x, y, p) - offset(y, p)
        return 0.5 * slope(x, p) * across * across

    return attraction


def pull_of(electrodes: Sequence[Electrode]) -> Function:
    """Return the force of the electrodes on the block, positive to the right."""
    right = attraction_of(electrodes[0])
    if len(electrodes) == 1:

        def pull(v, w, y, p):  # type: ignore[no-untyped-def]
            return right(v, y[X2], y, p)

        return pull
    left = attraction_of(electrodes[1])

    def both(v, w, y, p):  # type: ignore[no-untyped-def]
        return right(v, y[X2], y, p) - left(w, -y[X2], y, p)

    return both


def all_rates(
    kinds: Sequence[TermKind],
    places: ArrayLayout,
    parts: Sequence[TermContribution],
    electrodes: Sequence[Electrode],
) -> Function:
    """Return the function that writes the derivatives of all states of terms."""
    found: list[tuple[int, Function]] = []
    for part, at in zip(parts, places.terms, strict=True):
        found += zip(at.y.values(), map(voltage_independent, part.rates), strict=True)
    for side, (electrode, own) in enumerate(zip(electrodes, places.electrodes, strict=True)):
        for kind, at in zip(kinds, own, strict=True):
            rates = kind.term.electrode_rates(at, kind.shape, electrode)
            sided = [at_left(rate) if side else at_right(rate) for rate in rates]
            found += zip(at.y.values(), sided, strict=True)
    return rate_writer(found)


def rate_limits(
    kinds: Sequence[TermKind], places: ArrayLayout, electrodes: Sequence[Electrode]
) -> tuple[LimitedState, ...]:
    """Return the limited states of all electrodes."""
    found = []
    for side, (electrode, own) in enumerate(zip(electrodes, places.electrodes, strict=True)):
        for kind, at in zip(kinds, own, strict=True):
            limit = kind.term.rate_limit(at, kind.shape, electrode)
            if limit is not None:
                rate = at_left(limit.rate) if side else at_right(limit.rate)
                place, prefix = at.y[limit.state], ("", "left ")[side]
                found.append(LimitedState(place, prefix, limit._replace(rate=rate)))
    return tuple(found)


def voltage_independent(rate: Function) -> Function:
    """Return a function of state and parameters as one of the voltages, too."""

    def driven(v, w, y, p):  # type: ignore[no-untyped-def]
        return rate(y, p)

    return driven


def at_right(rate: Function) -> Function:
    """Return the rate of a state at the right electrode as a function of both voltages."""

    def driven(v, w, y, p):  # type: ignore[no-untyped-def]
        return rate(v, y[X2], y[V2], y, p)

    return driven


def at_left(rate: Function) -> Function:
    """Return the rate of a state at the left electrode as a function of both voltages."""

    def driven(v, w, y, p):  # type: ignore[no-untyped-def]
        return rate(w, -y[X2], -y[V2], y, p)

    return driven


def rate_writer(rates: Sequence[tuple[int, Function]]) -> Function:
    """Return the function that writes rates at their indices."""
    if not rates:

        def nothing(v, w, y, p, dy):  # type: ignore[no-untyped-def]
            pass

        return nothing
    (place, rate), rest = rates[0], rate_writer(rates[1:])

    def fill(v, w, y, p, dy):  # type: ignore[no-untyped-def]
        dy[place] = rate(v, w, y, p)
        rest(v, w, y, p, dy)

    return fill


# --- Automaton of an actuator with terms

LOAD_RATE_STEP = 1e-3  # difference step of the rate of a load, in units of sqrt(m2/k)
CONTACT_STEP_RATIO = 1e-6  # difference step of derivatives with compliant stoppers


def forces_of(model: Model) -> tuple[Function, Function, Function, Function]:
    """Return the forces that determine modes and margins.

    Returns
    -------
    load : callable
        ``load(side, v, w, y, p)``, the force of a moving block on the frame; `side` is that of a
        compliant stopper in contact, 0 for none.
    moved : callable
        ``moved(mode, v, w, y, p)``, the total force on the frame without friction.
    pressing : callable
        ``pressing(side, direction, v, w, y, p)``, the contact force between a block at rest and a
        stopper, for a slip in `direction`.
    resting_acceleration : callable
        ``resting_acceleration(direction, y, p)``, that of frame and block together.
    """
    pull, force, stopper = model.pull, model.force, model.stopper
    on_frame, on_block = model.on_frame, model.on_block
    sliding_friction, adhesion = model.sliding_friction, model.adhesion
    rigid = stopper is None

    def inner(v, w, y, p):  # type: ignore[no-untyped-def]
        return eq.load(y[X2], y[V2], pull(v, w, y, p) + force(y, p), p)

    if stopper is None:

        def load(side, v, w, y, p):  # type: ignore[no-untyped-def]
            return inner(v, w, y, p)

    else:

        def load(side, v, w, y, p):  # type: ignore[no-untyped-def]
            found = inner(v, w, y, p)
            if side != 0:
                depth = side * y[X2] - p[eq.DELTA]
                found += side * (stopper(depth, side * y[V2], p) - adhesion(p))
            return found

    def moved(mode, v, w, y, p):  # type: ignore[no-untyped-def]
        side = side_of(mode)
        if rigid and side != 0:
            return on_frame(y, p) + on_block(y, p)
        return load(side, v, w, y, p) + on_frame(y, p)

    def resting_acceleration(direction, y, p):  # type: ignore[no-untyped-def]
        if direction == 0:
            return 0.0
        outside = on_frame(y, p) + on_block(y, p)
        return (outside - sliding_friction(direction, y[V1], p)) / (p[eq.M1] + p[eq.M2])

    def pressing(side, direction, v, w, y, p):  # type: ignore[no-untyped-def]
        carried = p[eq.M2] * resting_acceleration(direction, y, p)
        held = eq.load(side * p[eq.DELTA], 0.0, pull(v, w, y, p) + force(y, p), p)
        return side * (on_block(y, p) - held - carried) + adhesion(p)

    return load, moved, pressing, resting_acceleration


@cache
def composed_automaton(
    kinds: tuple[TermKind, ...],
    voltage: Callable[..., float],
    voltage_rate: Callable[..., float],
    left: Callable[..., float] | None = None,
    left_rate: Callable[..., float] | None = None,
    bounds: bool = True,
) -> Automaton:
    """Return the automaton of an actuator with terms under the waveform ``voltage(t, q)``.

    Parameters
    ----------
    kinds : tuple of TermKind
        Kinds of the terms.
    voltage, voltage_rate, left, left_rate, bounds
        As for `mems_impact.actuator.automaton.actuator_automaton`.
    """
    model = compose(kinds, 1 if left is None else 2)
    load, moved, pressing, resting_acceleration = forces_of(model)
    static_limit, sliding_friction = model.static_limit, model.sliding_friction
    on_frame, on_block, rates = model.on_frame, model.on_block, model.rates
    restitution, hardness = model.restitution, model.stopper_slopes
    rigid, sticks = model.stopper is None, model.sticks
    n, scratch, begin = len(model.layout.states), model.layout.scratch, model.layout.drive
    volts = voltages(voltage, left, begin)
    volt_rates = voltages(voltage_rate, left_rate, begin)

    def flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        v, w = volts(t, p)
        direction, side = direction_of(mode), side_of(mode)
        if rigid and side != 0:
            dy[X2] = 0.0
            dy[V1] = resting_acceleration(direction, y, p)
            dy[V2] = 0.0
        else:
            own = load(side, v, w, y, p)
            a1 = 0.0
            if direction != 0:
                friction = sliding_friction(direction, y[V1], p)
                a1 = (own + on_frame(y, p) - friction) / p[eq.M1]
            dy[X2] = y[V2]
            dy[V1] = a1
            dy[V2] = (on_block(y, p) - own) / p[eq.M2] - a1
        dy[X1] = y[V1] if direction != 0 else 0.0
        rates(v, w, y, p, dy)

    def friction_mode(mode, v, w, y, p):  # type: ignore[no-untyped-def]
        # A slipping frame slips on. At rest it sticks by Equation (4), or slips with the force.
        if y[V1] != 0.0:
            return friction_towards(y[V1])
        own = moved(mode, v, w, y, p)
        if sticks and abs(own) <= static_limit(p):
            return STUCK
        return friction_towards(own if own != 0.0 else 1.0)

    def contact_mode(kept, v, w, y, p):  # type: ignore[no-untyped-def]
        # The contact of the block. A contact with a compliant stopper persists, and starts if the
        # block moves into the stopper at its face. On either kind of stopper, a block at rest with
        # a positive contact force is in contact.
        if not rigid and kept != FREE:
            return kept
        for contact in (RIGHT, LEFT):
            side = 1 if contact == RIGHT else -1
            depth = side * y[X2] - p[eq.DELTA]
            if not rigid and (depth > 0.0 or (depth == 0.0 and side * y[V2] > 0.0)):
                return contact
            if depth >= 0.0 and y[V2] == 0.0:
                friction = friction_mode(mode_of(STUCK, contact), v, w, y, p)
                if pressing(side, direction_of(friction), v, w, y, p) > 0.0:
                    return contact
        return FREE

    def mode_under(kept, v, w, y, p):  # type: ignore[no-untyped-def]
        contact = contact_mode(kept, v, w, y, p)
        return mode_of(friction_mode(mode_of(STUCK, contact), v, w, y, p), contact)

    def difference_force(code, mode, v, w, y, p):  # type: ignore[no-untyped-def]
        # The force whose rate is computed by differences. It excludes the force of a compliant
        # stopper, which is nonlinear over less than the difference step.
        if code == RELEASE:
            return pressing(side_of(mode), direction_of(mode), v, w, y, p)
        return moved(mode if rigid else mode % 3, v, w, y, p)

    def slope_along(code, mode, t, y, p):  # type: ignore[no-untyped-def]
        # Differences along the flow and along the voltage rates, since voltages jump at switches.
        # The force is smooth, unlike a margin, so the points may be far apart for fast charges.
        v, w = volts(t, p)
        dv, dw = volt_rates(t, p)
        h = LOAD_RATE_STEP * (p[eq.M2] / p[eq.K]) ** 0.5
        slope = p[scratch : scratch + n]
        x = p[scratch + n : scratch + 2 * n]
        flow(mode, t, y, p, slope)
        total = 0.0
        for point in range(4):
            size = 1 + point // 2
            sign = 1.0 - 2.0 * (point % 2)
            s = sign * size * h
            for k in range(n):
                x[k] = y[k] + s * slope[k]
            found = difference_force(code, mode, v + s * dv, w + s * dw, x, p)
            total += sign * (8.0 if size == 1 else -1.0) * found
        rate = total / (12.0 * h)
        side = side_of(mode)
        if not rigid and code == BREAK_AWAY and side != 0:
            by_depth, by_rate = hardness(side * y[X2] - p[eq.DELTA], side * y[V2], p)
            rate += by_depth * slope[X2] + by_rate * slope[V2]
        return rate

    def margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
        v, w = volts(t, p)
        direction, side = direction_of(mode), side_of(mode)
        for i in range(COUNT):
            g[i] = 1.0
            r[i] = 1.0
        if side == 0:
            g[RIGHT_IMPACT] = p[eq.DELTA] - y[X2]
            r[RIGHT_IMPACT] = -y[V2]
            g[LEFT_IMPACT] = p[eq.DELTA] + y[X2]
            r[LEFT_IMPACT] = y[V2]
        elif rigid:
            g[RELEASE] = pressing(side, direction, v, w, y, p)
            r[RELEASE] = slope_along(RELEASE, mode, t, y, p)
        else:
            g[RELEASE] = side * y[X2] - p[eq.DELTA]
            r[RELEASE] = side * y[V2]
        if direction != 0:
            force = moved(mode, v, w, y, p) - sliding_friction(direction, y[V1], p)
            mass = p[eq.M1] + p[eq.M2] if rigid and side != 0 else p[eq.M1]
            g[SLIP_END] = direction * y[V1]
            r[SLIP_END] = direction * force / mass
        else:
            push = moved(mode, v, w, y, p)
            rate = slope_along(BREAK_AWAY, mode, t, y, p)
            g[BREAK_AWAY], r[BREAK_AWAY] = static_reserve(static_limit(p), push, rate)

    def apply_impact(side, resting, y, p):  # type: ignore[no-untyped-def]
        y[X2] = side * p[eq.DELTA]
        if rigid:
            e = 0.0 if resting else restitution(abs(y[V2]), p)
            y[V1] = impact_law.frame_speed_after(y[V1], y[V2], e, p)
            y[V2] = impact_law.block_speed_after(y[V2], e)

    def transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
        v, w = volts(t, p)
        if code in (RIGHT_IMPACT, LEFT_IMPACT):
            apply_impact(1 if code == RIGHT_IMPACT else -1, False, y, p)
        elif code in (COUNT + RIGHT_IMPACT, COUNT + LEFT_IMPACT):
            # A complete chatter sequence ends like an impact without rebound.
            apply_impact(1 if code == COUNT + RIGHT_IMPACT else -1, True, y, p)
        elif code == RELEASE:
            # Depth or force is zero up to rounding: release for either sign.
            y[X2] = side_of(mode) * p[eq.DELTA]
            return mode_of(friction_mode(mode_of(STUCK, FREE), v, w, y, p), FREE)
        elif code == SLIP_END:
            y[V1] = 0.0
        elif code == BREAK_AWAY:
            # The force is at the static limit up to rounding: slip on either side of it.
            y[V1] = 0.0
            return mode_of(friction_towards(moved(mode, v, w, y, p)), mode // 3)
        return mode_under(mode // 3, v, w, y, p)

    automaton = Automaton(
        states=model.layout.states,
        modes=MODES,
        guards=GUARDS if rigid else tuple(replace(guard, impact=False) for guard in GUARDS),
        flow=flow,
        margins=margins,
        transition=transition,
        cyclic=model.cyclic,
        stiff=any(kind.term.stiff for kind in kinds),
        step=1e-3 if rigid else CONTACT_STEP_RATIO,
        bounds=bounds,
        recipe=(composed_automaton, (kinds, voltage, voltage_rate, left, left_rate, bounds)),
    )
    return limited(automaton, model, volts, volt_rates) if model.limits else automaton


def limited(automaton: Automaton, model: Model, volts: Any, volt_rates: Any) -> Automaton:
    """Return the automaton with further modes in which limited rates have their largest values.

    A mode is that of `automaton`, plus the number of its modes times a number to base three: a
    digit 0 for each rate within its limit, 1 at the largest and 2 at the smallest one.
    """
    base, m, count = len(automaton.modes), len(automaton.guards), len(model.limits)
    n, scratch, total = len(automaton.states), model.layout.scratch, m + count
    places = tuple(each.place for each in model.limits)
    right, left = model.limits[0].limit, model.limits[-1].limit
    right_rate, right_most, left_rate, left_most = right.rate, right.most, left.rate, left.most
    move, base_margins, base_transition = automaton.flow, automaton.margins, automaton.transition

    def rate(i, v, w, y, p):  # type: ignore[no-untyped-def]
        return right_rate(v, w, y, p) if i == 0 else left_rate(v, w, y, p)

    def most(i, p):  # type: ignore[no-untyped-def]
        return right_most(p) if i == 0 else left_most(p)

    def digit(i, mode):  # type: ignore[no-untyped-def]
        return (mode // base if i == 0 else mode // base // 3) % 3

    def with_digit(i, mode, value):  # type: ignore[no-untyped-def]
        weight = base if i == 0 else 3 * base
        return mode + (value - digit(i, mode)) * weight

    def flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        move(mode % base, t, y, p, dy)
        v, w = volts(t, p)
        for i in range(count):
            own = digit(i, mode)
            if own == 0:
                dy[places[i]] = rate(i, v, w, y, p)
            else:
                dy[places[i]] = most(i, p) if own == 1 else -most(i, p)

    def margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
        base_margins(mode % base, t, y, p, g, r)
        v, w = volts(t, p)
        dv, dw = volt_rates(t, p)
        h = LOAD_RATE_STEP * (p[eq.M2] / p[eq.K]) ** 0.5
        slope = p[scratch : scratch + n]
        x = p[scratch + n : scratch + 2 * n]
        flow(mode, t, y, p, slope)
        for i in range(count):
            change = 0.0
            for point in range(4):
                size = 1 + point // 2
                s = (1.0 - 2.0 * (point % 2)) * size * h
                for k in range(n):
                    x[k] = y[k] + s * slope[k]
                found = rate(i, v + s * dv, w + s * dw, x, p)
                change += (8.0 if size == 1 else -1.0) * found * s / size
            change /= 12.0 * h * h
            own, now, limit = digit(i, mode), rate(i, v, w, y, p), most(i, p)
            if own == 0:
                g[m + i], r[m + i] = static_reserve(limit, now, change)
            else:
                sign = 1.0 if own == 1 else -1.0
                g[m + i] = sign * now - limit
                r[m + i] = sign * change

    def transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
        v, w = volts(t, p)
        if m <= code < total:
            # The rate is at its limit up to rounding, and continuous.
            i = code - m
            beyond = 1 if rate(i, v, w, y, p) > 0.0 else 2
            return with_digit(i, mode, beyond if digit(i, mode) == 0 else 0)
        own = code - 2 * count if code >= 2 * total else (code - count if code > m else code)
        found = mode - mode % base + base_transition(mode % base, own, t, y, p)
        if code == 2 * total:
            for i in range(count):
                now = rate(i, v, w, y, p)
                beyond = 1 if now > 0.0 else 2
                found = with_digit(i, found, beyond if abs(now) > most(i, p) else 0)
        return found

    suffixes = [
        ("", *(f"-{each.side.replace(' ', '-')}{name}" for name in each.limit.modes))
        for each in model.limits
    ]
    return replace(
        automaton,
        modes=tuple(
            f"{mode}{''.join(reversed(added))}"
            for added in product(*reversed(suffixes))
            for mode in automaton.modes
        ),
        guards=(
            *automaton.guards,
            *(Guard(f"{each.side}{each.limit.event}", order=m + i)
              for i, each in enumerate(model.limits)),
        ),
        flow=flow,
        margins=margins,
        transition=transition,
    )  # fmt: skip


def static_reserve(limit: float, push: float, rate: float) -> tuple[float, float]:
    """Return the reserve of static friction under a force `push`, and its rate.

    It equals limit - abs(push) to first order near the limit, but is smooth at push = 0: in contact
    with a compliant stopper the force changes fast.
    """
    if limit == 0.0:
        return -abs(push), -rate if push > 0.0 else rate
    return 0.5 * (limit - push * push / limit), -push * rate / limit


def voltages(right: Function, left: Function | None, begin: int) -> Any:
    """Return the voltages of both electrodes as a function of time; 0 for an absent one."""
    if left is None:

        def one(t, p):  # type: ignore[no-untyped-def]
            return right(t, p[begin:]), 0.0

        return one

    def both(t, p):  # type: ignore[no-untyped-def]
        q = p[begin:]
        return right(t, q), left(t, q)

    return both
