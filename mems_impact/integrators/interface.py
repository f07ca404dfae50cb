"""The interface between the event loop and an integrator.

The loop of `mems_impact.hybrid.event_loop.loop` is written in terms of the functions below and
nothing else. Interpreted, they call the methods of an `Engine` in the file `interpreted` of a
method's folder; compiled by numba, overloads take their place (`integrators.jit.kernels` and the
file `compiled` of the folder), so that one text of the loop serves both.

An engine holds one system of ``n`` equations with ``m`` margins. Its root functions are, in this
order, the ``m`` margins (plus their bias), the ``m`` rates of the margins and one section:
``2 m + 1`` in all. `step` takes exactly one internal step of the method, or stops at the first root
in it, or in what is left of the last step after a root. Because a step never depends on who looks
at it, a run is the same whether or not it is sampled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

__all__ = ["Engine", "Equations"]

# --- The contract between the event loop and whatever integrates an arc.

# What `step` answers: the codes of CVODE. Negative is a failure (see FAILURES).
STEPPED = 0
STOPPED = 1
ROOT = 2
# No step: from here the engine goes on in another way. The arc ends, and the next one begins, by
# `restart`, with the state as it is.
HANDOVER = 3

NON_FINITE = -8  # CV_RHSFUNC_FAIL: the only way in which our right-hand side fails
# CV_ILL_INPUT, which within an arc means that a root function is zero for longer than roots are
# told apart: one that changes slowly is, to rounding. An arc that begins there goes on.
CLOSE_ROOTS = -22
ROOT_FUNCTION_FAILED = -12  # CV_RTFUNC_FAIL: the only way in which our root functions fail
FAILURES = {
    -1: "too many internal steps",
    -2: "the tolerances are too tight for the arithmetic",
    -3: "the local error test failed repeatedly or with the smallest step",
    -4: "the nonlinear solver did not converge",
    NON_FINITE: "the right-hand side is not finite",
    ROOT_FUNCTION_FAILED: "the margin of a guard is not a number",
}


def step(engine: Any) -> int:
    """Take one internal step, or go to the first root in it; STEPPED, STOPPED, ROOT or < 0."""
    return engine.step()


def time(engine: Any) -> float:
    """Return the time at which the last `step` ended."""
    return engine.time()


def state(engine: Any, y: Any) -> None:
    """Copy the state at `time` into `y`."""
    engine.state(y)


def end_margins(engine: Any, out: Any) -> None:
    """Write the m margins at `time`, then their m rates, into `out`.

    They are those of the arc: where it ends at its stop, of the number before.
    """
    engine.ended(out)


def root_directions(engine: Any, i: int) -> int:
    """Return -1, 0 or 1: how root function `i` crossed zero at the last ROOT."""
    return engine.fired(i)


def interpolate(engine: Any, t: float, y: Any) -> None:
    """Write the state at `t`, within the last internal step, into `y`; the run is not disturbed."""
    engine.interpolate(t, y)


def restart(engine: Any, mode: int, t: float, y: Any, stop: float) -> None:
    """Begin an arc at (t, y) in `mode`, of which nothing is evaluated from `stop` on (inf: none).

    A function of time that jumps at the stop is right-continuous; the arc before the jump sees
    it only up to the number before the stop.
    """
    engine.restart(mode, t, y, stop)


def sharpen(engine: Any, share: float, lasts: float) -> None:
    """Let the next arc err by so small a `share` of the tolerances; its flight `lasts` so long.

    For that arc alone, by 1 at most. A method that errs by far less in short flights need not.
    """
    engine.sharpen(share, lasts)


def reset(engine: Any, max_step: float) -> None:
    """Forget all that was before, as if the engine were new; no step is longer than `max_step`."""
    engine.renew(max_step)


def method_memory(engine: Any, mode: int) -> int:
    """Return what the engine has learnt of `mode`, with which it begins the next arc there."""
    return engine.remembered(mode)


def bias(engine: Any, i: int) -> float:
    """Return what is added to margin `i` when its roots are looked for."""
    return float(engine.bias[i])


def set_bias(engine: Any, i: int, value: float) -> None:
    """Set what is added to margin `i` when its roots are looked for."""
    engine.bias[i] = value


def parameter(engine: Any, i: int) -> float:
    """Return parameter `i`."""
    return engine.parameters[i]


def set_parameter(engine: Any, i: int, value: float) -> None:
    """Set parameter `i`, from the next evaluation on."""
    engine.parameters[i] = float(value)


def flow(engine: Any, mode: int, t: float, y: Any, dy: Any) -> None:
    """Write the derivative of the state in `mode` into `dy`."""
    engine.flow(mode, t, y, dy)


def margins(engine: Any, mode: int, t: float, y: Any, out: Any) -> None:
    """Write the m margins, then their m rates, into `out`."""
    engine.margins(mode, t, y, out)


def transition(engine: Any, mode: int, code: int, t: float, y: Any) -> int:
    """Apply the transition `code` in `mode`, changing `y` in place; return the new mode."""
    return engine.transition(mode, code, t, y)


# --- What an engine integrates.


@dataclass(frozen=True, kw_only=True)
class Equations:
    """The functions of an automaton with all their numbers.

    Parameters
    ----------
    flow, margins, transition, jacobian : callable
        See `mems_impact.hybrid.automaton.Automaton`.
    n, m, modes : int
        Number of states, of guards and of modes.
    parameters : array_like of float
    section : tuple (component, level, direction), optional
        Crossings of ``y[component] = level`` that are reported as the last root function.
    bounds : bool, optional
        Whether compiled functions are kept from reading and writing beyond their arrays.
    """

    flow: Callable[..., Any]
    margins: Callable[..., Any]
    transition: Callable[..., Any]
    n: int
    m: int
    parameters: Any
    jacobian: Callable[..., Any] | None = None
    section: tuple[int, float, int] | None = None
    bounds: bool = True
    modes: int = 1

    @property
    def crossing(self) -> tuple[int, float, int]:
        """The section, with component -1 where there is none."""
        return (-1, 0.0, 0) if self.section is None else self.section


# --- What all engines answer to runs.


class Engine:
    """An engine of one method, which learns nothing of modes and has no memory of its own."""

    @property
    def implicit_arcs(self) -> int:
        """Number of arcs begun by the second of two methods."""
        return 0

    def export_memory(self) -> tuple[int, ...]:
        """Return what the engine has learnt of each mode."""
        return ()

    def import_memory(self, known: tuple[int, ...]) -> None:
        """Begin with what was learnt of each mode."""

    def is_stiff(self) -> bool:
        """Return whether stability, not accuracy, has limited steps."""
        return False

    def close(self) -> None:
        """Free the memory of the engine."""
