"""A hybrid automaton as a value: modes, flow, margins, transitions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mems_impact.errors import InvalidParameter


@dataclass(frozen=True, kw_only=True)
class Guard:
    """One condition that ends an arc.

    A guard watches a *margin*: a quantity that is positive while the arc is admissible. The guard
    fires when the margin falls through zero.

    Parameters
    ----------
    name : str
        What the tables call the event.
    order : int
        Guards that fire in the same instant are handled in ascending order.
    impact : bool
        True if the margin is a gap and the transition an impact: its closest approaches are
        recorded, and a sequence of impacts that accumulates is completed (see `Automaton`).
    """

    name: str
    order: int
    impact: bool = False


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

    def __post_init__(self) -> None:
        orders = [guard.order for guard in self.guards]
        if len(set(orders)) != len(orders):
            raise InvalidParameter(
                field="guards",
                value=orders,
                allowed="an order of its own for each guard, so that simultaneous ones are decided",
            )

    @property
    def switch_code(self) -> int:
        """The code of `transition` for "the drive has just switched"."""
        return 2 * len(self.guards)
