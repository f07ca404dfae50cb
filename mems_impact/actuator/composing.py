"""The equations of an actuator with terms, put together from what each contributes.

Each sum, and each chain of what is put into a place, is a function that calls the next, so that the
compiler sees plain calls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from typing import Any

from mems_impact.actuator import equations as eq
from mems_impact.actuator.modes import STATES, V2, X1, X2
from mems_impact.actuator.terms.base import (
    Contribution,
    Electrode,
    Function,
    Places,
    TermKind,
)

__all__ = ["Arrangement", "Model", "compose", "layout"]

SCRATCH = 2  # arrays of the size of the state, between the numbers of the terms and of the drive


@dataclass(frozen=True)
class Arrangement:
    """Where everything stands in the arrays of parameters and states.

    Attributes
    ----------
    states : tuple of str
    terms : tuple of Places
        Of each term, without electrodes.
    electrodes : tuple of tuple of Places
        Of each term at each electrode.
    scratch, drive : int
        Where scratch arrays and the numbers of the drive begin in ``p``.
    """

    states: tuple[str, ...]
    terms: tuple[Places, ...]
    electrodes: tuple[tuple[Places, ...], ...]
    scratch: int
    drive: int


def layout(kinds: Sequence[TermKind], electrodes: int) -> Arrangement:
    """Return where everything stands; a left electrode's states are called ``left_...``."""
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
    return Arrangement(tuple(states), terms, sides, scratch, scratch + SCRATCH * len(states))


@dataclass(frozen=True)
class Model:
    """An actuator with terms, as functions for numba; see `mems_impact.actuator.terms.base`.

    Attributes
    ----------
    layout : Arrangement
    contributions : tuple of Contribution
        In the order of the terms.
    electrodes : tuple of Electrode
        The right one, and the left one where there is one.
    pull : callable
        ``pull(v, w, y, p)`` of the electrodes, positive to the right, where the drive puts v on the
        right one and w on the left one.
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
        ``stopper(depth, rate, p)``; None for stoppers that are rigid.
    stopper_slopes : callable
        ``stopper_slopes(depth, rate, p)``, its derivatives by both.
    rates : callable
        ``rates(v, w, y, p, dy)`` writes the derivatives of the states of the terms.
    sticks : bool
    cyclic : tuple of int
        Places of the states that no function reads.
    """

    layout: Arrangement
    contributions: tuple[Contribution, ...]
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
    sticks: bool
    cyclic: tuple[int, ...]


@cache
def compose(kinds: tuple[TermKind, ...], electrodes: int) -> Model:
    """Return the equations of an actuator with terms and one or two electrodes."""
    places = layout(kinds, electrodes)
    parts = tuple(
        kind.term.contribution(at, kind.shape) for kind, at in zip(kinds, places.terms, strict=True)
    )
    ends = tuple(electrode_of(kinds, own) for own in places.electrodes)
    normal = multiplied([part.normal for part in parts if part.normal])
    return Model(
        layout=places,
        contributions=parts,
        electrodes=ends,
        pull=pull_of(ends),
        force=summed([part.force for part in parts if part.force]),
        on_frame=summed([part.on_frame for part in parts if part.on_frame]),
        on_block=summed([part.on_block for part in parts if part.on_block]),
        static_limit=limit_of(normal),
        sliding_friction=friction_of(chosen(parts, "friction") or eq.mu_d, normal),
        restitution=chosen(parts, "restitution") or eq.restitution,
        adhesion=chosen(parts, "adhesion") or eq.no_adhesion,
        stopper=chosen(parts, "stopper"),
        stopper_slopes=chosen(parts, "stopper_slopes") or eq.no_slopes,
        rates=all_rates(kinds, places, parts, ends),
        sticks=all(part.sticks for part in parts),
        cyclic=cyclic_of(parts, places),
    )


def cyclic_of(parts: Sequence[Contribution], places: Arrangement) -> tuple[int, ...]:
    """Return the places of the states that no function reads: x1 as a rule, and sums of terms."""
    frame = () if any(part.places_frame for part in parts) else (X1,)
    sums = (at.y[each] for part, at in zip(parts, places.terms, strict=True) for each in part.sums)
    return (*frame, *sums)


def chosen(parts: Sequence[Contribution], name: str) -> Any:
    """Return what a term puts into a place of which there is one; None if no term does."""
    found = [each for part in parts if (each := getattr(part, name))]
    return found[-1] if found else None


def summed(functions: Sequence[Function]) -> Function:
    """Return the sum of functions ``f(y, p)``."""
    if not functions:

        def nothing(y, p):  # type: ignore[no-untyped-def]
            return 0.0

        return nothing
    if len(functions) == 1:
        return functions[0]
    first, rest = functions[0], summed(functions[1:])

    def both(y, p):  # type: ignore[no-untyped-def]
        return first(y, p) + rest(y, p)

    return both


def multiplied(functions: Sequence[Function]) -> Function:
    """Return the product of functions ``f(p)``."""
    if not functions:

        def one(p):  # type: ignore[no-untyped-def]
            return 1.0

        return one
    first, rest = functions[0], multiplied(functions[1:])

    def both(p):  # type: ignore[no-untyped-def]
        return first(p) * rest(p)

    return both


def limit_of(normal: Function) -> Function:
    """Return the load that static friction holds."""

    def static_limit(p):  # type: ignore[no-untyped-def]
        return eq.static_limit(p) * normal(p)

    return static_limit


def friction_of(coefficient: Function, normal: Function) -> Function:
    """Return the friction on a frame that slips."""

    def sliding_friction(direction, v1, p):  # type: ignore[no-untyped-def]
        weight = (p[eq.M1] + p[eq.M2]) * p[eq.G] * normal(p)
        return direction * coefficient(direction * v1, p) * weight

    return sliding_friction


def electrode_of(kinds: tuple[TermKind, ...], places: Sequence[Places]) -> Electrode:
    """Return an electrode with all that terms make of it."""

    def node(v, x, y, p):  # type: ignore[no-untyped-def]
        return v

    def offset(y, p):  # type: ignore[no-untyped-def]
        return 0.0

    electrode = Electrode(eq.capacitance, eq.capacitance_slope, node, offset)
    ordered = sorted(zip(kinds, places, strict=True), key=lambda each: each[0].term.layer)
    for kind, at in ordered:
        electrode = kind.term.electrode(at, kind.shape, electrode)
    return electrode


def attraction_of(electrode: Electrode) -> Function:
    """Return the force with which an electrode pulls."""
    _, slope, node, offset = electrode

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
    places: Arrangement,
    parts: Sequence[Contribution],
    electrodes: Sequence[Electrode],
) -> Function:
    """Return the function that writes the derivatives of all states of terms."""
    found: list[tuple[int, Function]] = []
    for part, at in zip(parts, places.terms, strict=True):
        found += zip(at.y.values(), map(undriven, part.rates), strict=True)
    for side, (electrode, own) in enumerate(zip(electrodes, places.electrodes, strict=True)):
        for kind, at in zip(kinds, own, strict=True):
            rates = kind.term.electrode_rates(at, kind.shape, electrode)
            sided = [at_left(rate) if side else at_right(rate) for rate in rates]
            found += zip(at.y.values(), sided, strict=True)
    return filling(found)


def undriven(rate: Function) -> Function:
    """Return a rate that no voltage enters as a function of the voltages too."""

    def driven(v, w, y, p):  # type: ignore[no-untyped-def]
        return rate(y, p)

    return driven


def at_right(rate: Function) -> Function:
    """Return the rate of a state at the right electrode as a function of all."""

    def driven(v, w, y, p):  # type: ignore[no-untyped-def]
        return rate(v, y[X2], y[V2], y, p)

    return driven


def at_left(rate: Function) -> Function:
    """Return the rate of a state at the left electrode as a function of all."""

    def driven(v, w, y, p):  # type: ignore[no-untyped-def]
        return rate(w, -y[X2], -y[V2], y, p)

    return driven


def filling(rates: Sequence[tuple[int, Function]]) -> Function:
    """Return the function that writes rates into their places."""
    if not rates:

        def nothing(v, w, y, p, dy):  # type: ignore[no-untyped-def]
            pass

        return nothing
    (place, rate), rest = rates[0], filling(rates[1:])

    def fill(v, w, y, p, dy):  # type: ignore[no-untyped-def]
        dy[place] = rate(v, w, y, p)
        rest(v, w, y, p, dy)

    return fill
