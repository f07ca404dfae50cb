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
    RateBound,
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
        Indices of each term that is not at an electrode.
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

    def add_states(names: Sequence[str], prefix: str = "") -> dict[str, int]:
        start = len(states)
        states.extend(prefix + name for name in names)
        return {name: start + i for i, name in enumerate(names)}

    starts = list(accumulate((kind.length for kind in kinds), initial=eq.DRIVE))
    terms = tuple(
        kind.indices(start, add_states(kind.term.states(kind.shape)))
        for kind, start in zip(kinds, starts, strict=False)
    )
    electrode_indices = tuple(
        tuple(
            kind.indices(start, add_states(kind.term.electrode_states(kind.shape), prefix))
            for kind, start in zip(kinds, starts, strict=False)
        )
        for prefix in ("", "left_")[:electrodes]
    )
    scratch = starts[-1]
    return ArrayLayout(
        tuple(states), terms, electrode_indices, scratch, scratch + SCRATCH_ARRAYS * len(states)
    )


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
    state : int
        Index of the state.
    side : str
        "" for the right electrode, "left " for the left one.
    limit : RateBound
        With ``rate(v, w, y, p)``.
    """

    state: int
    side: str
    limit: RateBound


@cache
def compose(kinds: tuple[TermKind, ...], electrode_count: int) -> Model:
    """Return the equations of an actuator with terms and one or two electrodes."""
    indices = layout(kinds, electrode_count)
    contributions = tuple(
        kind.term.contribution(term_indices, kind.shape)
        for kind, term_indices in zip(kinds, indices.terms, strict=True)
    )
    electrodes = tuple(
        electrode_of(kinds, electrode_indices, side)
        for electrode_indices, side in zip(indices.electrodes, (1, -1), strict=False)
    )
    factors = [factor for part in contributions if (factor := part.normal_force_factor)]
    normal = product_of(factors)
    return Model(
        layout=indices,
        contributions=contributions,
        electrodes=electrodes,
        pull=pull_of(electrodes),
        force=total_of([part.force for part in contributions if part.force]),
        on_frame=total_of([part.on_frame for part in contributions if part.on_frame]),
        on_block=total_of([part.on_block for part in contributions if part.on_block]),
        static_limit=limit_of(normal),
        sliding_friction=friction_of(override(contributions, "friction") or eq.mu_d, normal),
        restitution=override(contributions, "restitution") or impact_law.restitution,
        adhesion=override(contributions, "adhesion") or eq.no_adhesion,
        stopper=override(contributions, "stopper"),
        stopper_slopes=override(contributions, "stopper_slopes") or eq.no_slopes,
        rates=all_rates(kinds, indices, contributions, electrodes),
        limits=rate_limits(kinds, indices, electrodes),
        sticks=all(part.sticks for part in contributions),
        cyclic=cyclic_of(contributions, indices),
    )


def cyclic_of(contributions: Sequence[TermContribution], indices: ArrayLayout) -> tuple[int, ...]:
    """Return the indices of the states that no function reads: usually x1, and sums of terms."""
    frame = () if any(part.depends_on_x1 for part in contributions) else (X1,)
    sums = (
        term_indices.y[each]
        for part, term_indices in zip(contributions, indices.terms, strict=True)
        for each in part.sums
    )
    return (*frame, *sums)


def override(contributions: Sequence[TermContribution], name: str) -> Any:
    """Return the function `name` of the term that provides it; None without such a term."""
    functions = [function for part in contributions if (function := getattr(part, name))]
    return functions[-1] if functions else None


def total_of(functions: Sequence[Function]) -> Function:
    """Return the sum of functions ``f(y, p)``."""
    if not functions:

        def zero(y, p):  # type: ignore[no-untyped-def]
            return 0.0

        return zero
    if len(functions) == 1:
        return functions[0]
    first, remainder = functions[0], total_of(functions[1:])

    def total(y, p):  # type: ignore[no-untyped-def]
        return first(y, p) + remainder(y, p)

    return total


def product_of(functions: Sequence[Function]) -> Function:
    """Return the product of functions ``f(p)``."""
    if not functions:

        def unity(p):  # type: ignore[no-untyped-def]
            return 1.0

        return unity
    first, remainder = functions[0], product_of(functions[1:])

    def total(p):  # type: ignore[no-untyped-def]
        return first(p) * remainder(p)

    return total


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
    kinds: tuple[TermKind, ...], indices: Sequence[ParameterIndices], side: int
) -> Electrode:
    """Return the electrode on `side` as modified by all terms."""

    def node(v, x, y, p):  # type: ignore[no-untyped-def]
        return v

    def offset(y, p):  # type: ignore[no-untyped-def]
        return 0.0

    electrode = Electrode(eq.capacitance, eq.capacitance_slope, node, offset, side)
    layers = sorted(zip(kinds, indices, strict=True), key=lambda item: item[0].term.layer)
    for kind, term_indices in layers:
        if kind.term.replaced_rule == "electrode" and not kind.term.acts_at(kind.shape, side):
            continue
        electrode = kind.term.electrode(term_indices, kind.shape, electrode)
    return electrode


def attraction_of(electrode: Electrode) -> Function:
    """Return the attractive force of an electrode."""
    slope, node, offset = electrode.slope, electrode.node, electrode.offset

    def attraction(v, x, y, p):  # type: ignore[no-untyped-def]
        gap_voltage = node(v, x, y, p) - offset(y, p)
        return 0.5 * slope(x, p) * gap_voltage * gap_voltage

    return attraction


def pull_of(electrodes: Sequence[Electrode]) -> Function:
    """Return the force of the electrodes on the block, positive to the right."""
    right = attraction_of(electrodes[0])
    if len(electrodes) == 1:

        def pull(v, w, y, p):  # type: ignore[no-untyped-def]
            return right(v, y[X2], y, p)

        return pull
    left = attraction_of(electrodes[1])

    def two_sided_pull(v, w, y, p):  # type: ignore[no-untyped-def]
        return right(v, y[X2], y, p) - left(w, -y[X2], y, p)

    return two_sided_pull


def all_rates(
    kinds: Sequence[TermKind],
    indices: ArrayLayout,
    contributions: Sequence[TermContribution],
    electrodes: Sequence[Electrode],
) -> Function:
    """Return the function that writes the derivatives of all states of terms."""
    entries: list[tuple[int, Function]] = []
    for part, term_indices in zip(contributions, indices.terms, strict=True):
        entries += zip(term_indices.y.values(), map(voltage_independent, part.rates), strict=True)
    for side, (electrode, electrode_indices) in enumerate(
        zip(electrodes, indices.electrodes, strict=True)
    ):
        for kind, term_indices in zip(kinds, electrode_indices, strict=True):
            rates = kind.term.electrode_rates(term_indices, kind.shape, electrode)
            electrode_rates = [at_left(rate) if side else at_right(rate) for rate in rates]
            entries += zip(term_indices.y.values(), electrode_rates, strict=True)
    return rate_writer(entries)


def rate_limits(
    kinds: Sequence[TermKind], indices: ArrayLayout, electrodes: Sequence[Electrode]
) -> tuple[LimitedState, ...]:
    """Return the limited states of all electrodes."""
    limits = []
    for side, (electrode, electrode_indices) in enumerate(
        zip(electrodes, indices.electrodes, strict=True)
    ):
        for kind, term_indices in zip(kinds, electrode_indices, strict=True):
            limit = kind.term.rate_limit(term_indices, kind.shape, electrode)
            if limit is not None:
                rate = at_left(limit.rate) if side else at_right(limit.rate)
                index, prefix = term_indices.y[limit.state], ("", "left ")[side]
                limits.append(LimitedState(index, prefix, limit._replace(rate=rate)))
    return tuple(limits)


def voltage_independent(rate: Function) -> Function:
    """Return a function of state and parameters as one of the voltages, too."""

    def two_voltage_rate(v, w, y, p):  # type: ignore[no-untyped-def]
        return rate(y, p)

    return two_voltage_rate


def at_right(rate: Function) -> Function:
    """Return the rate of a state at the right electrode as a function of both voltages."""

    def two_voltage_rate(v, w, y, p):  # type: ignore[no-untyped-def]
        return rate(v, y[X2], y[V2], y, p)

    return two_voltage_rate


def at_left(rate: Function) -> Function:
    """Return the rate of a state at the left electrode as a function of both voltages."""

    def two_voltage_rate(v, w, y, p):  # type: ignore[no-untyped-def]
        return rate(w, -y[X2], -y[V2], y, p)

    return two_voltage_rate


def rate_writer(rates: Sequence[tuple[int, Function]]) -> Function:
    """Return the function that writes rates at their indices."""
    if not rates:

        def write_none(v, w, y, p, dy):  # type: ignore[no-untyped-def]
            pass

        return write_none
    (index, rate), write_others = rates[0], rate_writer(rates[1:])

    def write(v, w, y, p, dy):  # type: ignore[no-untyped-def]
        dy[index] = rate(v, w, y, p)
        write_others(v, w, y, p, dy)

    return write


# --- Automaton of an actuator with terms

LOAD_RATE_STEP = 1e-3  # difference step of the rate of a load, in units of sqrt(m2/k)


def forces_of(model: Model) -> tuple[Function, Function, Function, Function]:
    """Return the forces that determine modes and margins.

    Returns
    -------
    load : callable
        ``load(side, v, w, y, p)``, the force of a moving block on the frame; `side` is that of a
        compliant stopper in contact, 0 for none.
    frame_force : callable
        ``frame_force(mode, v, w, y, p)``, the total force on the frame without friction.
    contact_force : callable
        ``contact_force(side, direction, v, w, y, p)``, between a block at rest and a
        stopper, for a slip in `direction`.
    resting_acceleration : callable
        ``resting_acceleration(direction, y, p)``, the acceleration of frame and block together.
    """
    pull, force, stopper = model.pull, model.force, model.stopper
    on_frame, on_block = model.on_frame, model.on_block
    sliding_friction, adhesion = model.sliding_friction, model.adhesion
    is_rigid = stopper is None

    def free_load(v, w, y, p):  # type: ignore[no-untyped-def]
        return eq.load(y[X2], y[V2], pull(v, w, y, p) + force(y, p), p)

    if stopper is None:

        def load(side, v, w, y, p):  # type: ignore[no-untyped-def]
            return free_load(v, w, y, p)

    else:

        def load(side, v, w, y, p):  # type: ignore[no-untyped-def]
            total = free_load(v, w, y, p)
            if side != 0:
                depth = side * y[X2] - p[eq.DELTA]
                total += side * (stopper(depth, side * y[V2], p) - adhesion(p))
            return total

    def frame_force(mode, v, w, y, p):  # type: ignore[no-untyped-def]
        side = side_of(mode)
        if is_rigid and side != 0:
            return on_frame(y, p) + on_block(y, p)
        return load(side, v, w, y, p) + on_frame(y, p)

    def resting_acceleration(direction, y, p):  # type: ignore[no-untyped-def]
        if direction == 0:
            return 0.0
        external_force = on_frame(y, p) + on_block(y, p)
        return (external_force - sliding_friction(direction, y[V1], p)) / (p[eq.M1] + p[eq.M2])

    def contact_force(side, direction, v, w, y, p):  # type: ignore[no-untyped-def]
        inertia = p[eq.M2] * resting_acceleration(direction, y, p)
        block_load = eq.load(side * p[eq.DELTA], 0.0, pull(v, w, y, p) + force(y, p), p)
        return side * (on_block(y, p) - block_load - inertia) + adhesion(p)

    return load, frame_force, contact_force, resting_acceleration


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
    load, frame_force, contact_force, resting_acceleration = forces_of(model)
    static_limit, sliding_friction = model.static_limit, model.sliding_friction
    on_frame, on_block, rates = model.on_frame, model.on_block, model.rates
    restitution, stopper_slopes = model.restitution, model.stopper_slopes
    is_rigid, sticks = model.stopper is None, model.sticks
    n, scratch, drive_start = len(model.layout.states), model.layout.scratch, model.layout.drive
    voltages_at = voltages(voltage, left, drive_start)
    voltage_rates_at = voltages(voltage_rate, left_rate, drive_start)

    def flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        v, w = voltages_at(t, p)
        direction, side = direction_of(mode), side_of(mode)
        if is_rigid and side != 0:
            dy[X2] = 0.0
            dy[V1] = resting_acceleration(direction, y, p)
            dy[V2] = 0.0
        else:
            frame_force = load(side, v, w, y, p)
            a1 = 0.0
            if direction != 0:
                friction = sliding_friction(direction, y[V1], p)
                a1 = (frame_force + on_frame(y, p) - friction) / p[eq.M1]
            dy[X2] = y[V2]
            dy[V1] = a1
            dy[V2] = (on_block(y, p) - frame_force) / p[eq.M2] - a1
        dy[X1] = y[V1] if direction != 0 else 0.0
        rates(v, w, y, p, dy)

    def friction_mode(mode, v, w, y, p):  # type: ignore[no-untyped-def]
        # A slipping frame slips on. At rest it sticks by Equation (4), or slips with the force.
        if y[V1] != 0.0:
            return friction_towards(y[V1])
        force = frame_force(mode, v, w, y, p)
        if sticks and abs(force) <= static_limit(p):
            return STUCK
        return friction_towards(force if force != 0.0 else 1.0)

    def contact_mode(last_contact, v, w, y, p):  # type: ignore[no-untyped-def]
        # The contact of the block. A contact with a compliant stopper persists, and starts if the
        # block moves into the stopper at its face. On either kind of stopper, a block at rest with
        # a positive contact force is in contact.
        if not is_rigid and last_contact != FREE:
            return last_contact
        for contact in (RIGHT, LEFT):
            side = 1 if contact == RIGHT else -1
            depth = side * y[X2] - p[eq.DELTA]
            if not is_rigid and (depth > 0.0 or (depth == 0.0 and side * y[V2] > 0.0)):
                return contact
            if depth >= 0.0 and y[V2] == 0.0:
                friction = friction_mode(mode_of(STUCK, contact), v, w, y, p)
                if contact_force(side, direction_of(friction), v, w, y, p) > 0.0:
                    return contact
        return FREE

    def mode_under(last_contact, v, w, y, p):  # type: ignore[no-untyped-def]
        contact = contact_mode(last_contact, v, w, y, p)
        return mode_of(friction_mode(mode_of(STUCK, contact), v, w, y, p), contact)

    def difference_force(code, mode, v, w, y, p):  # type: ignore[no-untyped-def]
        # The force whose rate is computed by differences. It excludes the force of a compliant
        # stopper, which is nonlinear over less than the difference step.
        if code == RELEASE:
            return contact_force(side_of(mode), direction_of(mode), v, w, y, p)
        return frame_force(mode if is_rigid else mode % 3, v, w, y, p)

    def slope_along(code, mode, t, y, p):  # type: ignore[no-untyped-def]
        # Differences along the flow and along the voltage rates, since voltages jump at switches.
        # The force is smooth, unlike a margin, so the points may be far apart for fast charges.
        v, w = voltages_at(t, p)
        dv, dw = voltage_rates_at(t, p)
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
            force = difference_force(code, mode, v + s * dv, w + s * dw, x, p)
            total += sign * (8.0 if size == 1 else -1.0) * force
        rate = total / (12.0 * h)
        side = side_of(mode)
        if not is_rigid and code == BREAK_AWAY and side != 0:
            depth_slope, rate_slope = stopper_slopes(side * y[X2] - p[eq.DELTA], side * y[V2], p)
            rate += depth_slope * slope[X2] + rate_slope * slope[V2]
        return rate

    def margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
        v, w = voltages_at(t, p)
        direction, side = direction_of(mode), side_of(mode)
        for i in range(COUNT):
            g[i] = 1.0
            r[i] = 1.0
        if side == 0:
            g[RIGHT_IMPACT] = p[eq.DELTA] - y[X2]
            r[RIGHT_IMPACT] = -y[V2]
            g[LEFT_IMPACT] = p[eq.DELTA] + y[X2]
            r[LEFT_IMPACT] = y[V2]
        elif is_rigid:
            g[RELEASE] = contact_force(side, direction, v, w, y, p)
            r[RELEASE] = slope_along(RELEASE, mode, t, y, p)
        else:
            g[RELEASE] = side * y[X2] - p[eq.DELTA]
            r[RELEASE] = side * y[V2]
        if direction != 0:
            force = frame_force(mode, v, w, y, p) - sliding_friction(direction, y[V1], p)
            mass = p[eq.M1] + p[eq.M2] if is_rigid and side != 0 else p[eq.M1]
            g[SLIP_END] = direction * y[V1]
            r[SLIP_END] = direction * force / mass
        else:
            push = frame_force(mode, v, w, y, p)
            rate = slope_along(BREAK_AWAY, mode, t, y, p)
            g[BREAK_AWAY], r[BREAK_AWAY] = static_reserve(static_limit(p), push, rate)

    def apply_impact(side, is_rest, y, p):  # type: ignore[no-untyped-def]
        y[X2] = side * p[eq.DELTA]
        if is_rigid:
            e = 0.0 if is_rest else restitution(abs(y[V2]), p)
            y[V1] = impact_law.frame_speed_after(y[V1], y[V2], e, p)
            y[V2] = impact_law.block_speed_after(y[V2], e)

    def transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
        v, w = voltages_at(t, p)
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
            return mode_of(friction_towards(frame_force(mode, v, w, y, p)), mode // 3)
        return mode_under(mode // 3, v, w, y, p)

    automaton = Automaton(
        states=model.layout.states,
        modes=MODES,
        guards=GUARDS if is_rigid else tuple(replace(guard, impact=False) for guard in GUARDS),
        flow=flow,
        margins=margins,
        transition=transition,
        cyclic=model.cyclic,
        stiff=any(kind.term.stiff for kind in kinds),
        bounds=bounds,
        recipe=(composed_automaton, (kinds, voltage, voltage_rate, left, left_rate, bounds)),
    )
    return limited(automaton, model, voltages_at, voltage_rates_at) if model.limits else automaton


def limited(
    automaton: Automaton, model: Model, voltages_at: Any, voltage_rates_at: Any
) -> Automaton:
    """Return the automaton with further modes in which limited rates have their largest values.

    A mode is that of `automaton`, plus the number of its modes times a number to base three: a
    digit 0 for each rate within its limit, 1 at the largest and 2 at the smallest one.
    """
    base, m, count = len(automaton.modes), len(automaton.guards), len(model.limits)
    n, scratch, total = len(automaton.states), model.layout.scratch, m + count
    indices = tuple(each.state for each in model.limits)
    right, left = model.limits[0].limit, model.limits[-1].limit
    right_rate, right_max = right.rate, right.max_rate
    left_rate, left_max = left.rate, left.max_rate
    base_flow, base_margins, base_transition = (
        automaton.flow,
        automaton.margins,
        automaton.transition,
    )

    def rate(i, v, w, y, p):  # type: ignore[no-untyped-def]
        return right_rate(v, w, y, p) if i == 0 else left_rate(v, w, y, p)

    def max_rate(i, p):  # type: ignore[no-untyped-def]
        return right_max(p) if i == 0 else left_max(p)

    def digit(i, mode):  # type: ignore[no-untyped-def]
        return (mode // base if i == 0 else mode // base // 3) % 3

    def with_digit(i, mode, value):  # type: ignore[no-untyped-def]
        weight = base if i == 0 else 3 * base
        return mode + (value - digit(i, mode)) * weight

    def flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        base_flow(mode % base, t, y, p, dy)
        v, w = voltages_at(t, p)
        for i in range(count):
            limit_mode = digit(i, mode)
            if limit_mode == 0:
                dy[indices[i]] = rate(i, v, w, y, p)
            else:
                dy[indices[i]] = max_rate(i, p) if limit_mode == 1 else -max_rate(i, p)

    def margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
        base_margins(mode % base, t, y, p, g, r)
        v, w = voltages_at(t, p)
        dv, dw = voltage_rates_at(t, p)
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
                sample = rate(i, v + s * dv, w + s * dw, x, p)
                change += (8.0 if size == 1 else -1.0) * sample * s / size
            change /= 12.0 * h * h
            limit_mode, value, limit = digit(i, mode), rate(i, v, w, y, p), max_rate(i, p)
            if limit_mode == 0:
                g[m + i], r[m + i] = static_reserve(limit, value, change)
            else:
                sign = 1.0 if limit_mode == 1 else -1.0
                g[m + i] = sign * value - limit
                r[m + i] = sign * change

    def transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
        v, w = voltages_at(t, p)
        if m <= code < total:
            # The rate is at its limit up to rounding, and continuous.
            i = code - m
            limit_mode = 1 if rate(i, v, w, y, p) > 0.0 else 2
            return with_digit(i, mode, limit_mode if digit(i, mode) == 0 else 0)
        base_code = code - 2 * count if code >= 2 * total else (code - count if code > m else code)
        new_mode = mode - mode % base + base_transition(mode % base, base_code, t, y, p)
        if code == 2 * total:
            for i in range(count):
                value = rate(i, v, w, y, p)
                limit_mode = 1 if value > 0.0 else 2
                new_mode = with_digit(i, new_mode, limit_mode if abs(value) > max_rate(i, p) else 0)
        return new_mode

    suffixes = [
        ("", *(f"-{each.side.replace(' ', '-')}{name}" for name in each.limit.modes))
        for each in model.limits
    ]
    return replace(
        automaton,
        modes=tuple(
            f"{mode}{''.join(reversed(combination))}"
            for combination in product(*reversed(suffixes))
            for mode in automaton.modes
        ),
        guards=(
            *automaton.guards,
            *(Guard(f"{each.side}{each.limit.event}", order=m + i, condition=True)
              for i, each in enumerate(model.limits)),
        ),
        flow=flow,
        margins=margins,
        transition=transition,
    )  # fmt: skip


def static_reserve(limit: float, push: float, rate: float) -> tuple[float, float]:
    """Return the reserve of static friction under a force `push`, and its rate.

    The margin equals limit - abs(push) to first order near the limit, but is smooth at push = 0: in
    contact with a compliant stopper the force changes fast.
    """
    if limit == 0.0:
        return -abs(push), -rate if push > 0.0 else rate
    return 0.5 * (limit - push * push / limit), -push * rate / limit


def voltages(right: Function, left: Function | None, start: int) -> Any:
    """Return the voltages of both electrodes as a function of time; 0 for an absent one."""
    if left is None:

        def right_voltage(t, p):  # type: ignore[no-untyped-def]
            return right(t, p[start:]), 0.0

        return right_voltage

    def two_voltages(t, p):  # type: ignore[no-untyped-def]
        q = p[start:]
        return right(t, q), left(t, q)

    return two_voltages
