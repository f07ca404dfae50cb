"""The interface between the event loop and an integrator.

The event loop uses an integrator through the functions below only. Interpreted, they call the
methods of an engine in the file `interpreted` of a method's folder; compiled by numba, overloads
replace them (`integrators.jit.kernels` and the file `compiled` of the folder), so that both forms
share the source of the loop.

An engine has ``n`` equations with ``m`` margins. Its root functions are, in this order, the ``m``
margins, the ``m`` rates of the margins (each plus its bias) and one section: ``2 m + 1`` in all.
A method may leave out rates of margins without bias, unless closest approaches of the guard are
events and are searched.
`step` takes exactly one internal step of the method, or stops at the first root in it, or in the
remainder of the last step after a root. Steps do not depend on output times, so a run is the same
with and without samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

# --- Functions of an engine

# Return values of `step`: the codes of CVODE. Negative is a failure (see FAILURES).
STEPPED = 0
STOPPED = 1
ROOT = 2
# No step: the engine changes its method. The arc ends, and `restart` begins the next one at the
# same state.
HANDOVER = 3

NON_FINITE = -8  # CV_RHSFUNC_FAIL
# CV_ILL_INPUT within an arc: a root function is zero for longer than CVODE's root tolerance, for
# example one that changes slowly. A new arc continues from there.
CLOSE_ROOTS = -22
ROOT_FUNCTION_FAILED = -12  # CV_RTFUNC_FAIL
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

    At the stop of an arc they are the limits from the left.
    """
    engine.end_margins(out)


def root_directions(engine: Any, i: int) -> int:
    """Return the direction in which root function `i` crossed zero at the last ROOT, or 0."""
    return engine.root_directions(i)


def interpolate(engine: Any, t: float, y: Any) -> None:
    """Write the state at `t`, within the last internal step, into `y`; the run is unaffected.

    Columns of a known motion are defined at the ends of the step only, as for `state` at a root.
    """
    engine.interpolate(t, y)


def restart(engine: Any, mode: int, t: float, y: Any, stop: float) -> None:
    """Begin an arc at (t, y) in `mode` with evaluations before `stop` only (inf for none).

    A function of time that jumps at the stop is right-continuous; the arc evaluates it up to the
    last floating-point number before the stop.
    """
    engine.restart(mode, t, y, stop)


def sharpen(engine: Any, share: float, flight_time: float) -> None:
    """Reduce the tolerances of the next arc, a flight of `flight_time`, by the factor `share`.

    This holds for one arc; `share` is at most 1. A method with far smaller errors in short flights
    may ignore it.
    """
    engine.sharpen(share, flight_time)


def lengthen(engine: Any, longest: float) -> None:
    """Allow steps of up to `longest` until the next restart; a method may keep its limit."""
    engine.lengthen(longest)


def reset(engine: Any, max_step: float) -> None:
    """Restore the initial state of the engine, with the longest step `max_step`."""
    engine.reset(max_step)


def search_approaches(engine: Any, search: int) -> None:
    """Search closest approaches from the next step on if `search` is 1; a method may always do."""
    engine.approach_search = search


def method_memory(engine: Any, mode: int) -> int:
    """Return the engine's memory of `mode`, which determines the method of its next arc."""
    return engine.method_memory(mode)


def bias(engine: Any, i: int) -> float:
    """Return the bias added to margin `i`, or rate ``i - m``, in the root search."""
    return float(engine.bias[i])


def set_bias(engine: Any, i: int, value: float) -> None:
    """Set the bias added to margin `i`, or rate ``i - m``, in the root search."""
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


# --- Equations

# A step is as long as the error of the state and the error of each column, times this weight,
# allow: by `dop853` of its largest component, by others a norm as that of a state. The absolute
# tolerance of a column grows with its size, the largest component if that is above 1. On the
# paper's orbit, and wherever columns follow the state, the state limits the steps; where columns
# vary faster, their errors are ten tolerances.
COLUMN_WEIGHT = 0.1


@dataclass(frozen=True, kw_only=True)
class Equations:
    """The functions of an automaton with their dimensions and parameters."""

    flow: Callable[..., Any]  # this and the next two as in `mems_impact.hybrid.automaton.Automaton`
    margins: Callable[..., Any]
    transition: Callable[..., Any]
    n: int  # number of states
    m: int  # number of guards
    parameters: Any
    approaches: Sequence[bool]  # guards whose closest approaches are events
    # ``jacobian(mode, t, y, p, memory, entries)`` writes the derivative of component i of the flow
    # by component j into ``entries[i, j]``, for Newton's method; without it CVODE computes
    # differences.
    jacobian: Callable[..., Any] | None = None
    jacobian_memory: int = 0  # length of its scratch
    # Component, level and direction of crossings, the last root function.
    section: tuple[int, float, int] | None = None
    bounds: bool = True  # whether compiled functions check array bounds
    modes: int = 1
    # Number of components at the end of the state that `flow` only takes: for each component of the
    # state without them, its perturbations, one a column.
    columns: int = 0
    # Whether the motion of the columns is known, with the times of its events: columns are not
    # interpolated, and an arc may have few steps.
    known: bool = False

    @property
    def states(self) -> int:
        """The number of components without columns."""
        return self.n - self.columns

    @property
    def perturbations(self) -> int:
        """The number of columns."""
        return self.columns // max(self.states, 1)

    @property
    def interpolated(self) -> int:
        """The number of components that are interpolated within a step."""
        return self.states if self.known else self.n

    @property
    def crossing(self) -> tuple[int, float, int]:
        """The section, with component -1 for none."""
        return (-1, 0.0, 0) if self.section is None else self.section


# --- Base class of engines


class SingleMethodEngine:
    """Defaults for an engine with a single method, without memory of modes."""

    @property
    def implicit_arcs(self) -> int:
        """Number of arcs begun by an implicit alternative."""
        return 0

    def export_memory(self) -> tuple[int, ...]:
        """Return the memory of each mode."""
        return ()

    def import_memory(self, memory: tuple[int, ...]) -> None:
        """Set the memory of each mode."""

    def is_stiff(self) -> bool:
        """Return whether stability, not accuracy, has limited steps."""
        return False

    def close(self) -> None:
        """Free the memory of the engine."""
