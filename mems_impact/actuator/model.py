"""The equations of an actuator with its terms.

Sums and products of functions are nested functions, each of which calls the next, so that numba
compiles plain calls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from typing import Any, NamedTuple

from mems_impact._util.limits import Bound
from mems_impact.actuator import equations as eq
from mems_impact.actuator import impact_law
from mems_impact.actuator.equations import STATES, V2, X1, X2
from mems_impact.actuator.terms.base import (
    Electrode,
    Function,
    ParameterIndices,
    RateBound,
    TermContribution,
    TermKind,
)

HIDDEN = 2  # numbers between those of terms and drive (see `hidden_parameters`)


@dataclass(frozen=True)
class ArrayLayout:
    """Layout of the arrays of parameters and states."""

    states: tuple[str, ...]
    terms: tuple[ParameterIndices, ...]  # of each term that is not at an electrode
    electrodes: tuple[tuple[ParameterIndices, ...], ...]  # of each term at each electrode
    hidden: int  # first index in ``p`` of what `mems_impact.hybrid.definition` keeps there
    drive: int  # first index in ``p`` of the numbers of the drive


def layout(kinds: Sequence[TermKind], electrodes: int) -> ArrayLayout:
    """Return the layout; the states of a left electrode have the names ``left_...``."""
    states = list(STATES)

    def add_states(names: Sequence[str], prefix: str = "") -> dict[str, int]:
        start = len(states)
        states.extend(prefix + name for name in names)
        return {name: start + i for i, name in enumerate(names)}

    starts = list(accumulate((kind.length for kind in kinds), initial=eq.TERMS))
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
    return ArrayLayout(tuple(states), terms, electrode_indices, starts[-1], starts[-1] + HIDDEN)


@dataclass(frozen=True)
class Model:
    """An actuator with terms, as functions for numba; see `mems_impact.actuator.terms.base`.

    v, w and u are the voltages of the right electrode, of the left one and of a clamp.
    """

    layout: ArrayLayout
    contributions: tuple[TermContribution, ...]  # in the order of the terms
    electrodes: tuple[Electrode, ...]  # the right electrode, and the left one if present
    pull: Function  # ``(v, w, y, p)``, the force of the electrodes, positive to the right
    force: Function  # ``(y, p)`` of the terms, as the next two
    on_frame: Function
    on_block: Function
    normal_force: Function  # ``(v, w, u, p)``, between frame and ground
    clamp_driven: bool  # whether the normal force depends on v, w or u
    friction: Function  # ``(speed, p)``, the coefficient of a slip
    sliding_friction: Function  # ``(direction, v1, normal, p)``, at a normal force
    restitution: Function  # ``(speed, p)``
    adhesion: Function | None  # ``(p)``
    stopper: Function | None  # ``(depth, rate, p)``; None for rigid stoppers
    rates: tuple[Function, ...]  # ``(v, w, y, p)``, of each state of the terms, without limits
    limits: tuple[LimitedState, ...]  # states at electrodes whose rates are limited
    sticks: bool
    cyclic: tuple[int, ...]  # indices of the states that no function reads


class LimitedState(NamedTuple):
    """A state at an electrode with a limited rate."""

    state: int  # its index
    side: str  # "" for the right electrode, "left " for the left one
    limit: RateBound  # with ``rate(v, w, y, p)``


def bounds_of(kinds: Sequence[TermKind]) -> tuple[Bound, ...]:
    """Return the bounds that the numbers of an actuator with terms set for each other."""
    found, first = list(ORDERED), eq.TERMS
    compliant = any(kind.term.replaced_rule == "stopper" for kind in kinds)
    for kind in kinds:
        found += kind.term.bounds(kind.indices(first), kind.shape, compliant)
        first += kind.length
    return tuple(found)


def gap(p):  # type: ignore[no-untyped-def]
    """Return the gap."""
    return p[eq.D]


ORDERED = (
    Bound(name="delta", value=gap, upper=True, meaning="the gap d"),
    Bound(name="mu_d", value=eq.mu_s, upper=True, excluded=False, meaning="which is mu_s"),
)


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
    friction = override(contributions, "friction") or eq.mu_d
    limits = rate_limits(kinds, indices, electrodes)
    return Model(
        layout=indices,
        contributions=contributions,
        electrodes=electrodes,
        pull=pull_of(electrodes),
        force=total_of([part.force for part in contributions if part.force]),
        on_frame=total_of([part.on_frame for part in contributions if part.on_frame]),
        on_block=total_of([part.on_block for part in contributions if part.on_block]),
        normal_force=normal_force_of(contributions),
        clamp_driven=any(part.driven_clamp is not None for part in contributions),
        friction=friction,
        sliding_friction=friction_of(friction),
        restitution=override(contributions, "restitution") or impact_law.restitution,
        adhesion=override(contributions, "adhesion"),
        stopper=override(contributions, "stopper"),
        rates=all_rates(kinds, indices, contributions, electrodes, limits),
        limits=limits,
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


def zero(y, p):  # type: ignore[no-untyped-def]
    """Return 0."""
    return 0.0


def total_of(functions: Sequence[Function]) -> Function:
    """Return the sum of functions ``f(y, p)``, `zero` without any."""
    if not functions:
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


def normal_force_of(contributions: Sequence[TermContribution]) -> Function:
    """Return the normal force between frame and ground."""
    factor = product_of([each for part in contributions if (each := part.weight_factor)])

    def normal_force(v, w, u, p):  # type: ignore[no-untyped-def]
        return (p[eq.M1] + p[eq.M2]) * p[eq.G] * factor(p)

    for part in contributions:
        if part.clamp is not None:
            normal_force = pressed(normal_force, part.clamp)
        if part.driven_clamp is not None:
            normal_force = pressed_by_voltages(normal_force, part.driven_clamp)
    return normal_force


def pressed(force: Function, clamp: Function) -> Function:
    """Return a normal force increased by ``clamp(p)``."""

    def normal_force(v, w, u, p):  # type: ignore[no-untyped-def]
        return force(v, w, u, p) + clamp(p)

    return normal_force


def pressed_by_voltages(force: Function, clamp: Function) -> Function:
    """Return a normal force increased by ``clamp(v, w, u, p)``."""

    def normal_force(v, w, u, p):  # type: ignore[no-untyped-def]
        return force(v, w, u, p) + clamp(v, w, u, p)

    return normal_force


def friction_of(coefficient: Function) -> Function:
    """Return the friction force on a slipping frame."""

    def sliding_friction(direction, v1, normal, p):  # type: ignore[no-untyped-def]
        return direction * coefficient(direction * v1, p) * normal

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
        # A factor that need not wait for the voltage, whose cosine takes as long.
        return gap_voltage * gap_voltage * (0.5 * slope(x, p))

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
    limits: Sequence[LimitedState],
) -> tuple[Function, ...]:
    """Return the derivatives of all states of terms, in the order of the states."""
    rates = [voltage_independent(rate) for part in contributions for rate in part.rates]
    for side, (electrode, electrode_indices) in enumerate(
        zip(electrodes, indices.electrodes, strict=True)
    ):
        for kind, term_indices in zip(kinds, electrode_indices, strict=True):
            own = kind.term.electrode_rates(term_indices, kind.shape, electrode)
            rates += [at_left(rate) if side else at_right(rate) for rate in own]
    for each in limits:
        rates[each.state - len(STATES)] = each.limit.rate
    return tuple(rates)


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
