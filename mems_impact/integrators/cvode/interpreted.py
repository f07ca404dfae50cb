"""CVODE through scikit-sundae's Python interface."""

from __future__ import annotations

import contextlib
import io
import math
import threading
from typing import Any

import numpy as np

from mems_impact.errors import EngineUnavailable
from mems_impact.integrators import interface
from mems_impact.integrators.interface import Equations
from mems_impact.integrators.options import Options
from mems_impact.integrators.python_functions import FLOW, Functions, scalars

# --- First step and tolerances of an arc

MIN_RTOL = 1e-14  # smallest relative tolerance above rounding


def first_step(max_step: float, rtol: float, flight_time: float) -> float:
    """Return the first step of an arc with tolerance `rtol` and a flight of length `flight_time`.

    CVODE's default has an error of the whole tolerance, at order 1: more than the height of the
    flight after a weak impact. A far smaller step costs one or two steps per arc, and must exceed
    the spacing of floating-point numbers. In a short flight its error is a thousandth of the
    tolerance, so that CVODE detects the end of the flight.
    """
    default = 1e-13 + 256.0 * 2.0**-52 * max_step
    return min(default, 0.01 * math.sqrt(rtol) * flight_time)


def scaled_tolerances(rtol: float, atol: float, share: float) -> tuple[float, float]:
    """Return `rtol` and `atol` reduced by the factor `share`, bounded below."""
    return max(share * rtol, min(rtol, MIN_RTOL)), max(share * atol, 1e-300)


# --- CVODE through scikit-sundae's public API: the fallback of the compiled engine

# Standard output is global: concurrent redirections by two threads would lose it.
_STDOUT_LOCK = threading.Lock()


class _Failure(Exception):
    """Raised by a callback, with CVODE's code of the failure."""


class InterpretedCvode(Functions):
    """CVODE with Python callbacks and the interface of `mems_impact.integrators.interface`."""

    def __init__(self, equations: Equations, options: Options, max_step: float) -> None:
        super().__init__(equations)
        m, jacobian = equations.m, equations.jacobian
        memory = [0.0] * equations.jacobian_memory
        component, level, direction = equations.crossing
        self._mode = 0
        self._stop: float | None = None
        self._last_instant = math.inf
        self._result: Any = None
        self._t = 0.0
        self._root_values: Any = None

        def rhs(t: float, y: Any, dy: Any) -> None:
            self.flow(self._mode, min(t, self._last_instant), y, dy)
            if not np.isfinite(dy).all():
                raise _Failure(interface.NON_FINITE)

        def roots(t: float, y: Any, out: Any) -> None:
            if self._root_values is not None:
                out[:] = self._root_values
                return
            self.margins(self._mode, min(t, self._last_instant), y, out)
            out[: 2 * m] += self.bias
            if np.isnan(out[: 2 * m]).any():
                raise _Failure(interface.ROOT_FUNCTION_FAILED)
            # CVODE prints a warning about root functions that are zero for a whole step.
            out[m : 2 * m][out[m : 2 * m] == 0.0] = 1e-300
            out[2 * m] = y[component] - level if component >= 0 else 1.0

        def jacobian_entries(t: float, y: Any, _dy: Any, entries: Any) -> None:
            assert jacobian is not None
            entries[:] = 0.0
            time = min(t, self._last_instant)
            try:
                jacobian(self._mode, time, scalars(y, self.n), self.parameters, memory, entries)
            except Exception as error:
                self.record_fault(error, FLOW, self._mode, 0, time, y)
                raise _Failure(interface.NON_FINITE) from None

        roots.terminal = [False] * (2 * m + 1)  # type: ignore[attr-defined]
        roots.direction = [-1] * m + [1] * m + [direction]  # type: ignore[attr-defined]
        self._roots = roots
        self._other_directions = -np.array(roots.direction)  # type: ignore[attr-defined]
        self._arguments: dict[str, Any] = {
            "rhsfn": rhs,
            "method": options.method,
            "jacfn": jacobian_entries if jacobian is not None else None,
            "eventsfn": roots,
            "num_events": 2 * m + 1,
        }
        # Columns do not lessen the error of the state in the mean over all components.
        share = math.sqrt(self.states / self.n)
        self._rtol, self._atol = share * options.rtol, share * options.atol
        self.reset(max_step)

    def reset(self, max_step: float) -> None:
        """Restore the initial state, with the longest step `max_step`."""
        self._max_step = max_step
        self._create_solver(1.0, math.inf)

    def sharpen(self, share: float, flight_time: float) -> None:
        """Reduce the tolerances of the next arc by the factor `share`."""
        if share < 1.0 or self._share < 1.0:
            self._create_solver(share, flight_time)

    def lengthen(self, longest: float) -> None:
        """Do nothing: the longest step of a solver cannot be changed."""

    def _create_solver(self, share: float, flight_time: float) -> None:
        try:
            from sksundae.cvode import CVODE  # imports scipy.optimize
        except ImportError as error:
            reason, remedy = f"CVODE cannot be imported: {error}", "use method 'dop853' or 'auto'"
            raise EngineUnavailable(reason, remedy) from error

        # A solver's tolerances cannot be changed.
        self._share = share
        rtol, atol = scaled_tolerances(self._rtol, self._atol, share)
        initial_step = first_step(self._max_step, rtol, flight_time)
        self._solver = CVODE(
            **self._arguments,
            rtol=rtol,
            atol=atol,
            first_step=initial_step,
            max_step=self._max_step,
        )

    def restart(self, mode: int, t: float, y: Any, stop: float) -> None:
        """Begin an arc at (t, y) in `mode` with evaluations before `stop` only."""
        self._mode = int(mode)
        self._stop = stop if stop < math.inf else None
        self._last_instant = np.nextafter(stop, 0.0) if stop < math.inf else math.inf
        self._horizon = t + 1.0
        self._solver.init_step(t, np.array(y[: self.n]))
        self._t = t

    def step(self) -> int:
        """Take one internal step; STEPPED, STOPPED, ROOT or a negative code."""
        # scikit-sundae appends to these lists at every root and never clears them, so that every
        # result would contain all roots of the run (contract test: test_sksundae_event_log).
        for log in (self._roots._i, self._roots._t, self._roots._y):  # type: ignore[attr-defined]
            log.clear()
        # CVODE prints messages to standard output; its return code suffices.
        with _STDOUT_LOCK, contextlib.redirect_stdout(io.StringIO()):
            try:
                self._result = self._solver.step(self._horizon, method="onestep", tstop=self._stop)
            except _Failure as failure:
                return int(failure.args[0])
        self._t = float(np.ravel(self._result.t)[-1])
        self._horizon = self._t + 1.0
        return int(self._result.status)

    def time(self) -> float:
        """Return the time at which the last step ended."""
        return self._t

    def state(self, y: Any) -> None:
        """Copy the state at `time` into `y`."""
        y[: self.n] = self._result.y.tolist()

    def end_margins(self, out: Any) -> None:
        """Write margins and rates at `time` into `out`."""
        self.margins(self._mode, min(self._t, self._last_instant), self._result.y, out)

    def root_directions(self, i: int) -> int:
        """Return the direction in which root function `i` crossed zero at the last ROOT, or 0."""
        return int(self._result.i_events[-1][i])

    def interpolate(self, t: float, y: Any) -> None:
        """Write the state at `t`, within the last internal step, into `y`."""
        # On the way back CVODE searches for roots and loses those already found. So the root
        # functions are frozen at their known values, and the solver returns to its time afterwards.
        root_values = np.empty(2 * self.m + 1)
        self._roots(self._t, self._result.y, root_values)
        if self._result.status == interface.ROOT:
            # An exact zero is a crossing; if not reported, in the irrelevant direction.
            directions = np.array(self._result.i_events[-1])
            directions = np.where(directions == 0, self._other_directions, directions)
            root_values = np.where(root_values == 0.0, 1e-300 * directions, root_values)
        self._root_values = root_values
        y[: self.n] = self._solver.step(t, method="normal").y.tolist()
        self._solver.step(self._t, method="normal")
        self._root_values = None
