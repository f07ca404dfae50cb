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
    CYCLIC,
    HIT_BEGIN,
    HIT_TIME,
    IMPACT,
    ORDER,
    RECORDS,
)
from mems_impact.hybrid.pickling import portable
from mems_impact.integrators.python_functions import carry_out

# --- A hybrid automaton as a value: modes, flow, margins, transitions.


@dataclass(frozen=True)
class Guard:
    """One condition that ends an arc.

    A guard watches a *margin*: a quantity that is positive while the arc is admissible. The guard
    fires when the margin falls through zero.

    Parameters
    ----------
    name : str
        What the tables call the event.
    margin : callable, optional
        ``margin(mode, t, y, p)`` returns the margin.
    transition : callable, optional
        ``transition(mode, t, y, p)`` returns the new mode and the new state. Without it the guard
        only records: mode and state go on.
    modes : tuple of int, optional
        The modes that it watches; all by default.
    rate : callable, optional
        ``rate(mode, t, y, p)`` returns the time derivative of the margin along the flow. Without it
        it is taken by differences (see `mems_impact.hybrid.definition`).
    order : int, optional
        Guards that fire in the same instant are handled in ascending order; by default impacts come
        first, and then guards come as they are listed.
    impact : bool, optional
        True if the margin is a gap and the transition an impact: its closest approaches are
        recorded, and a sequence of impacts that accumulates is completed (see `Impact`).
    rest : callable, optional
        Of an impact; as `transition`.

    See Also
    --------
    Impact, System, modes

    Notes
    -----
    An `Automaton` has one function for all margins and one for all transitions. Where these are not
    made from its guards (see `mems_impact.hybrid.definition`), guards have a name and an order
    alone.

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
    rate: Callable[..., Any] | None = None
    order: int | None = None
    impact: bool = False
    rest: Callable[..., Any] | None = None

    @property
    def records(self) -> bool:
        """Whether it changes nothing, and only records."""
        return self.margin is not None and self.transition is None


@dataclass(frozen=True)
class Impact(Guard):
    """A guard whose margin is a gap between bodies, and whose transition is their impact.

    Parameters
    ----------
    name, margin, transition, modes, rate, order : optional
        As of a `Guard`; `margin` is the gap, and `transition` the rebound.
    rest : callable, optional
        ``rest(mode, t, y, p)`` returns the mode and the state in which the bodies stay together,
        when a sequence of ever weaker impacts has ended. Without it such a sequence ends the run.

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

    impact: bool = True


@dataclass(frozen=True, kw_only=True)
class Automaton:
    """Modes, flow, guards and transitions, written as plain scalar functions.

    The functions must be ones that numba can compile unchanged: arrays are read and written
    element by element, and whatever they call is such a function too. They run interpreted and
    compiled alike. ``y`` is the state, ``p`` the parameters, ``mode`` an index into `modes`.

    Parameters
    ----------
    states : tuple of str
        Names of the ``n`` components of the state.
    modes : tuple of str
        Names of the modes.
    guards : tuple of Guard
        The ``m`` guards; a guard's number is its place here.
    flow : callable
        ``flow(mode, t, y, p, dy)`` writes the time derivative of the state. It must be defined,
        finite and smooth a little beyond every guard, since a trial step may go there.
    margins : callable
        ``margins(mode, t, y, p, g, r)`` writes the margins ``g`` and their time derivatives ``r``.
        A margin that does not apply in `mode` is a positive constant, its rate too. The rates find
        the margins that dip below zero and come back within one step; a rate that is left at a
        positive constant gives up that protection. An impact needs its true rate: it is the speed
        of approach, by which a rebound is told from a contact that persists.
    transition : callable
        ``transition(mode, code, t, y, p)`` changes ``y`` in place and returns the new mode.
        ``code`` is the number of the guard; ``m + number`` when a sequence of impacts at that guard
        has accumulated (to be handled as an impact without rebound); ``2 m`` when the drive has
        just switched and the mode is to be settled anew.
    jacobian : callable, optional
        ``jacobian(mode, t, y, p, J)`` writes ``J[i, j]``, the derivative of component i of the flow
        by component j of the state; `J` comes filled with zeros. It serves Newton's method
        (method "bdf"), for which CVODE otherwise takes differences.
    cyclic : tuple of int
        Components that never enter flow, margins or transitions except by differences. They are
        integrated from zero in every arc and accumulated apart, so that they keep their digits.
    constrained : tuple of int, optional
        Modes whose states lie on a manifold, as where bodies are held together or a state slides
        along a surface. In these ``transition`` with the code ``2 m + 1`` puts a state onto it, by
        a projection: the flow stays on it, and what it does beside it means nothing.
    stiff : bool, optional
        Whether something may decay far faster than anything happens: method "auto" is then the one
        that suits its flow.
    bounds : bool, optional
        Whether its functions, compiled, are kept from reading and writing beyond their arrays: a
        call that does fails with a `FunctionError`. It costs up to 3 %.
    step : float, optional
        Of the differences that give derivatives by states and parameters, along a direction of
        length one: well below the sizes over which its functions bend.
    recipe : tuple of callable and tuple, optional
        A function and its arguments that make this automaton once more: how it is pickled, where
        its functions cannot be imported by their names.

    Notes
    -----
    ``t`` is measured from the start of the current period of the run.
    """

    states: tuple[str, ...]
    modes: tuple[str, ...]
    guards: tuple[Guard, ...]
    flow: Callable[..., Any]
    margins: Callable[..., Any]
    transition: Callable[..., Any]
    jacobian: Callable[..., Any] | None = None
    cyclic: tuple[int, ...] = ()
    step: float = 1e-3
    constrained: tuple[int, ...] = ()
    stiff: bool = False
    bounds: bool = field(default=True, compare=False)
    recipe: tuple[Callable[..., Any], tuple[Any, ...]] | None = field(
        default=None, compare=False, repr=False
    )

    def __post_init__(self) -> None:
        orders = [guard.order for guard in self.guards]
        if len(set(orders)) != len(orders):
            raise InvalidParameter(
                field="guards",
                value=orders,
                allowed="an order of its own for each guard, so that simultaneous ones are decided",
            )

    def __reduce__(self) -> Any:
        """Pickle the recipe; without one, the functions by their names."""
        if self.recipe is not None:
            make, arguments = self.recipe
            return make, portable(arguments)
        return _automaton, tuple(getattr(self, each.name) for each in fields(self))

    @property
    def switch_code(self) -> int:
        """The code of `transition` for "the drive has just switched"."""
        return 2 * len(self.guards)

    @property
    def projection_code(self) -> int:
        """The code of `transition` for "put the state onto what the mode holds"."""
        return 2 * len(self.guards) + 1

    # Its functions called one by one, in Python and with numbers of Python, whatever is given.

    def slope_at(self, mode: int, t: float, y: Floats, p: Floats) -> Floats:
        """Return the flow at a state, shape (n,)."""
        slope = [0.0] * len(self.states)
        self.flow(int(mode), float(t), *numbers(y, p), slope)
        return np.array(slope)

    def margins_at(
        self, mode: int, t: float, y: Floats, p: Floats, otherwise: float = 1.0
    ) -> tuple[Floats, Floats]:
        """Return margins and rates, shapes (m,); a margin that does not apply is `otherwise`."""
        m = len(self.guards)
        margins, rates = [otherwise] * m, [1.0] * m
        self.margins(int(mode), float(t), *numbers(y, p), margins, rates)
        return np.array(margins), np.array(rates)

    def state_after(
        self, mode: int, code: int, t: float, y: Floats, p: Floats
    ) -> tuple[int, Floats]:
        """Return mode and state after the transition `code`."""
        into, after = carry_out(self.transition, mode, code, t, *numbers(y, p))
        return into, np.array(after)

    @cached_property
    def rows(self) -> tuple[tuple[int, list[float]], ...]:
        """What it puts into the loop's table: rows of `workspace`, each with its numbers."""
        return (
            (ORDER, [float(guard.order or 0) for guard in self.guards]),
            (IMPACT, [float(guard.impact) for guard in self.guards]),
            (RECORDS, [float(guard.records) for guard in self.guards]),
            (CYCLIC, [float(i in self.cyclic) for i in range(len(self.states))]),
            (HIT_TIME, [-math.inf] * len(self.guards)),
            (HIT_BEGIN, [-math.inf] * len(self.guards)),
        )


def numbers(*arrays: Any) -> Iterator[list[float]]:
    """Yield the numbers of arrays as Python's own."""
    return (np.asarray(array, dtype=float).tolist() for array in arrays)


def _automaton(*values: Any) -> Automaton:
    names = [each.name for each in fields(Automaton)]
    return Automaton(**dict(zip(names, values, strict=True)))


# --- An automaton without its guards: every mode goes on for as long as it is told to.


def _margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
    g[0] = 1.0
    r[0] = 1.0


def _transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
    return mode


@cache
def unguarded(automaton: Automaton) -> Automaton:
    """Return the automaton that stays in the mode in which it starts, with the same flow."""
    never = (Guard(name="never", order=0),)
    return replace(
        automaton,
        guards=never,
        constrained=(),
        margins=_margins,
        transition=_transition,
        recipe=(unguarded, (automaton,)),
    )
