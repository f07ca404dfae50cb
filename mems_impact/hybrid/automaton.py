"""Hybrid automata: guards, impacts, modes and transitions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.event_loop.workspace import (
    CONDITION,
    CYCLIC,
    HIT_BEGIN,
    HIT_TIME,
    IMPACT,
    ORDER,
    RECORDS,
    TIMED,
)
from mems_impact.hybrid.pickling import portable
from mems_impact.integrators.python_functions import apply_transition

# --- Hybrid automaton

GENERATED = "<automaton>"  # file name of generated source, excluded from error reports


@dataclass(frozen=True)
class Guard:
    """One condition that ends an arc.

    A guard watches a *margin*: a quantity that is positive while the arc is admissible. The guard
    fires when the margin falls through zero.

    Parameters
    ----------
    name : str
        Name of the event in tables.
    margin : callable, optional
        ``margin(mode, t, y, p)`` returns the margin.
    transition : callable, optional
        ``transition(mode, t, y, p)`` returns the new mode and the new state. A guard without a
        transition only records: mode and state are unchanged.
    modes : tuple of int, optional
        Modes in which the guard is active; all by default.
    order : int, optional
        Simultaneous guards are handled in ascending order; by default impacts come first, then the
        other guards in the order of the list.
    condition : bool, optional
        True if the margin is a condition of the mode, such as a holding force: the guard then fires
        at once in a mode that begins where its margin is negative. By default the guard waits there
        until the margin has been positive.
    impact : bool, optional
        True if the margin is a gap and the transition an impact: its closest approaches are
        recorded, and a sequence of impacts that accumulates is completed (see `Impact`).
    rest : callable, optional
        Transition into sticking contact at the end of a chatter sequence (see `Impact`).

    See Also
    --------
    Impact, System, modes

    Notes
    -----
    An `Automaton` has one function for all margins and one function for all transitions. If the
    automaton was not generated from guards (see `mems_impact.hybrid.definition`), its guards have
    only a name and an order.

    Examples
    --------
    >>> import mems_impact as mi
    >>> def fall(mode, t, y, p):
    ...     return y.v, -1.0
    >>> def apex(mode, t, y, p):
    ...     return y.v
    >>> stone = mi.System(
    ...     states=("x", "v"), flow=fall, guards=[mi.Guard("apex", apex)], initial={"v": 1.0}
    ... )
    >>> event = mi.simulate(stone, duration=1.5).events.iloc[0]
    >>> event["event"], f"{event['t']:.9f}", f"{event['x']:.9f}"
    ('apex', '1.000000000', '0.500000000')
    """

    name: str
    margin: Callable[..., Any] | None = None
    transition: Callable[..., Any] | None = None
    _: KW_ONLY
    modes: tuple[int, ...] | None = None
    order: int | None = None
    condition: bool = False
    impact: bool = False
    rest: Callable[..., Any] | None = None

    @property
    def records(self) -> bool:
        """Whether the guard records its events without a transition."""
        return self.margin is not None and self.transition is None


@dataclass(frozen=True)
class Impact(Guard):
    """A guard whose margin is a gap between bodies, and whose transition is their impact.

    Parameters
    ----------
    name, margin, transition, modes, order : optional
        As in `Guard`; `margin` is the gap, and `transition` the rebound.
    rest : callable, optional
        ``rest(mode, t, y, p)`` returns mode and state of the sticking contact at the end of a
        chatter sequence. Without `rest` such a sequence ends the run.

    See Also
    --------
    Guard, System, Stopper

    Examples
    --------
    >>> import mems_impact as mi
    >>> def fall(mode, t, y, p):
    ...     return y.v, -1.0
    >>> def height(mode, t, y, p):
    ...     return y.x
    >>> def bounce(mode, t, y, p):
    ...     return mode, (0.0, -0.8 * y.v)
    >>> ball = mi.System(
    ...     states=("x", "v"), flow=fall, initial={"x": 0.5},
    ...     guards=[mi.Impact("floor", height, bounce)],
    ... )
    >>> [round(t, 9) for t in mi.simulate(ball, duration=5.0).impacts["t"]]  # 1, then 1 + 1.6, ...
    [1.0, 2.6, 3.88, 4.904]
    """

    impact: bool = field(default=True, init=False)


@dataclass(frozen=True, kw_only=True)
class Automaton:
    """Modes, flow, guards and transitions, written as plain scalar functions.

    The functions run interpreted and compiled by numba: they read and write arrays element by
    element, and call only functions of this kind. ``y`` is the state of n components, ``p`` the
    parameters, ``mode`` an index into `modes`; ``t`` is measured from the start of the current
    period of the run (see `clock`).

    ``flow(mode, t, y, p, dy)`` writes the time derivative of the state. It must be defined, finite
    and smooth a little beyond every guard, since a trial step may go there.

    ``margins(mode, t, y, p, g, r)`` writes the margins ``g`` of the m guards and their time
    derivatives ``r``. A margin that is inactive in `mode` is a positive constant, and so is its
    rate. The rates detect margins that become negative and positive again within one step; a
    constant rate disables this detection. An impact needs its true rate, the speed of approach,
    which distinguishes a rebound from a persistent contact.

    ``transition(mode, code, t, y, p)`` changes ``y`` in place and returns the new mode. ``code`` is
    the number of the guard; ``m + number`` at the accumulation point of impacts at that guard (an
    impact without rebound); ``2 m`` after a switch of the drive, when the mode has to be determined
    again.
    """

    states: tuple[str, ...]
    modes: tuple[str, ...]
    guards: tuple[Guard, ...]  # a guard's number is its place here
    flow: Callable[..., Any]
    margins: Callable[..., Any]
    transition: Callable[..., Any]
    # Components that enter flow, margins and transitions by differences only. Every arc integrates
    # them from zero, and their offsets are accumulated separately, which preserves their accuracy.
    cyclic: tuple[int, ...] = ()
    # Modes whose states lie on an invariant manifold, such as bodies in contact or a state that
    # slides along a surface. In these modes ``transition`` with the code ``2 m + 1`` projects a
    # state onto the manifold; the flow off the manifold has no meaning.
    constrained: tuple[int, ...] = ()
    # Whether the flow may have decay rates far above those of its motion; the default method is
    # then "auto".
    stiff: bool = False
    # Whether flow and margins have the period of the problem. Otherwise its switching times are
    # absolute.
    forced: bool = True
    # Index of the time base in the parameter array. The loop sets it to the start of the current
    # period, to which functions add ``t``.
    clock: int | None = None
    timed: tuple[int, ...] = ()  # guards whose margins add the time base
    # Whether compiled functions check array bounds: an access out of bounds raises FunctionError.
    # The checks cost up to 3 % of run time.
    bounds: bool = field(default=True, compare=False)
    # A function and its arguments that construct this automaton; used to pickle it if its functions
    # cannot be imported by name.
    recipe: tuple[Callable[..., Any], tuple[Any, ...]] | None = field(
        default=None, compare=False, repr=False
    )

    def __post_init__(self) -> None:
        orders = [guard.order for guard in self.guards]
        if len(set(orders)) != len(orders):
            raise InvalidParameter(
                field="guards",
                value=orders,
                allowed="a different order for each guard, for simultaneous events",
            )

    def __reduce__(self) -> Any:
        """Pickle the recipe; without one, functions by name."""
        if self.recipe is not None:
            constructor, arguments = self.recipe
            return constructor, portable(arguments)
        return _automaton, tuple(getattr(self, each.name) for each in fields(self))

    @property
    def switch_code(self) -> int:
        """The code of `transition` for "the drive has just switched"."""
        return 2 * len(self.guards)

    @property
    def projection_code(self) -> int:
        """The code of `transition` for the projection onto the manifold of a mode."""
        return 2 * len(self.guards) + 1

    # Interpreted evaluation of single functions, with Python floats.

    def slope_at(self, mode: int, t: float, y: Floats, p: Floats) -> Floats:
        """Return the flow at a state, shape (n,)."""
        slope = [0.0] * len(self.states)
        self.flow(int(mode), float(t), *numbers(y, p), slope)
        return np.array(slope)

    def margins_at(
        self, mode: int, t: float, y: Floats, p: Floats, inactive_value: float = 1.0
    ) -> tuple[Floats, Floats]:
        """Return margins and rates, shapes (m,); an inactive margin is `inactive_value`."""
        m = len(self.guards)
        margins, rates = [inactive_value] * m, [1.0] * m
        self.margins(int(mode), float(t), *numbers(y, p), margins, rates)
        return np.array(margins), np.array(rates)

    def state_after(
        self, mode: int, code: int, t: float, y: Floats, p: Floats
    ) -> tuple[int, Floats]:
        """Return mode and state after the transition `code`."""
        new_mode, after = apply_transition(self.transition, mode, code, t, *numbers(y, p))
        return new_mode, np.array(after)

    @cached_property
    def rows(self) -> tuple[tuple[int, list[float]], ...]:
        """Rows of the loop's table that the automaton determines, as (row number, values)."""
        return (
            (ORDER, [float(guard.order or 0) for guard in self.guards]),
            (IMPACT, [float(guard.impact) for guard in self.guards]),
            (RECORDS, [float(guard.records) for guard in self.guards]),
            (CONDITION, [float(guard.condition or guard.impact) for guard in self.guards]),
            (TIMED, [float(i in self.timed) for i in range(len(self.guards))]),
            (CYCLIC, [float(i in self.cyclic) for i in range(len(self.states))]),
            (HIT_TIME, [-math.inf] * len(self.guards)),
            (HIT_BEGIN, [-math.inf] * len(self.guards)),
        )


def numbers(*arrays: Any) -> Iterator[list[float]]:
    """Yield arrays as lists of Python floats."""
    return (np.asarray(array, dtype=float).tolist() for array in arrays)


def _automaton(*values: Any) -> Automaton:
    names = [each.name for each in fields(Automaton)]
    return Automaton(**dict(zip(names, values, strict=True)))


# --- An automaton without guards


def _margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
    g[0] = 1.0
    r[0] = 1.0


def _transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
    return mode


@cache
def unguarded(automaton: Automaton) -> Automaton:
    """Return the automaton with the same flow that stays in its initial mode."""
    guards = (Guard(name="never", order=0),)
    return replace(
        automaton,
        guards=guards,
        constrained=(),
        margins=_margins,
        transition=_transition,
        recipe=(unguarded, (automaton,)),
    )
