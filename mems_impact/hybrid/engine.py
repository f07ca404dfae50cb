"""Engines: an integrator bound to the equations of a problem, and the memory of the event loop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import monotonic, thread_time
from types import SimpleNamespace
from typing import Any, NamedTuple, Protocol

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import FunctionError, FunctionsMissing
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.event_loop.long_steps import STEPS_PER_PERIOD
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.availability import engine_class, is_compiled
from mems_impact.integrators.interface import Equations
from mems_impact.integrators.options import Options


class Engine(Protocol):
    """Interface of an engine to Python; `integrators.interface` is that to the event loop."""

    @property
    def implicit_arcs(self) -> int:
        """Arcs begun so far by the implicit method."""

    def export_memory(self) -> tuple[int, ...]:
        """Return the method's memory of each mode; empty if it has none."""

    def import_memory(self, memory: tuple[int, ...]) -> None:
        """Set the method's memory of each mode."""

    def is_stiff(self) -> bool:
        """Return whether stability, not accuracy, has limited steps; False if unknown."""

    def close(self) -> None:
        """Free the memory of the engine."""


@dataclass(frozen=True)
class EngineBinding:
    """An engine for one problem, and calls of functions over `integrators.interface` on it."""

    # ``call(function, *arguments)`` calls `function`, written over
    # `mems_impact.integrators.interface`, with the engine as its first argument; compiled for a
    # compiled engine.
    call: Callable[..., Any]
    engine: Engine
    # ``table(rows, width)`` returns rows of zeros, long enough for a state with its columns: an
    # array, or for interpreted code lists, which Python reads several times as fast.
    table: Callable[[int, int], Any]
    # ``record(dtype, arrays, numbers)`` returns a record with the fields of `dtype`: zero except
    # for `arrays`, which it does not keep alive, and `numbers`.
    record: Callable[..., Any]
    quota: StepQuota  # of each call of the event loop
    # ``kernel_addresses(clock, observe, n, count)`` returns the addresses that compiled code of
    # `recurrence` calls, and an object that has to live as long; interpreted, `observe` itself.
    kernel_addresses: Callable[..., tuple[dict[str, Any], Any]]
    # ``tangents_reference(tangents, n, size)`` returns the address of the compiled function of
    # `mems_impact.hybrid.variational.flow.event_tangents`, and an object that has to live as long;
    # interpreted, the function itself.
    tangents_reference: Callable[[Callable[..., Any], int, int], tuple[Any, Any]]
    array_reference: Callable[[Any], Any]  # returns an array's address, or the array, for a record


CALL_SECONDS = 0.1  # processor time of a call of a loop
MAX_CALL_SECONDS = 0.5  # its duration: functions may wait, and threads may be more than cores


@dataclass
class StepQuota:
    """The number of steps after which a loop returns to Python, adapted to the times above.

    Between calls Python handles Ctrl-C and reports progress. It waits for the global interpreter
    lock, 5 ms for each thread that computes in Python, in which the core is idle.
    """

    # Of the next call. At first so few that they take less than a second, whatever a step costs.
    steps: int
    last: int = 0  # of the last call

    def call(self, function: Callable[..., int], *arguments: Any) -> int:
        """Call a function, with the number of steps as its last argument; return its status."""
        self.last, begin, begin_of_work = self.steps, monotonic(), thread_time()
        status = function(*arguments, self.steps)
        growth = min(
            CALL_SECONDS / max(thread_time() - begin_of_work, 1e-9),
            MAX_CALL_SECONDS / max(monotonic() - begin, 1e-9),
        )
        if growth < 1.0 or status == workspace.PAUSED:  # otherwise it took fewer steps
            self.steps = max(1, int(self.steps * min(growth, 2.0)))
        return status

    def discard_growth(self) -> None:
        """Undo the growth by the last call, which took fewer steps than it could."""
        self.steps = min(self.steps, self.last)


class Extension(NamedTuple):
    """The equations of the states of a problem and of columns behind them.

    Margins and transitions take the state without its last `columns` components, which may belong
    to a `known` motion (see `Equations`).
    """

    automaton: Automaton
    parameters: Any
    columns: int
    known: bool


def create_engine(
    problem: Problem, extension: Extension | None = None, *, sectioned: bool = True
) -> EngineBinding:
    """Create the engine that the problem's options require, of its equations or an extension.

    An extension has no section; unless `sectioned`, the problem's own is not observed. Raises
    EngineUnavailable if the interpreted engine needs scikit-sundae, and it is not installed;
    FunctionsMissing if the problem has no functions; FunctionError if a function cannot be
    compiled. Later calls raise FunctionError if a function fails.
    """
    if problem.unavailable_reason:
        raise FunctionsMissing(problem.unavailable_reason)
    options = problem.options
    automaton, parameters, columns, known = extension or (
        problem.automaton, problem.parameters, 0, False,
    )  # fmt: skip
    equations = Equations(
        flow=automaton.flow,
        margins=automaton.margins,
        transition=automaton.transition,
        n=len(automaton.states),
        m=len(automaton.guards),
        modes=len(automaton.modes),
        parameters=parameters,
        approaches=[guard.impact for guard in automaton.guards],
        section=problem.section if sectioned and extension is None else None,
        bounds=automaton.bounds,
        columns=columns,
        known=known,
    )
    if not columns and (options.method == "bdf" or (options.method == "auto" and automaton.stiff)):
        from mems_impact.hybrid.variational.tangents import flow_jacobian, jacobian_memory

        n, count = equations.n, len(parameters)
        equations = replace(
            equations,
            jacobian=flow_jacobian(automaton.flow, n, count),
            jacobian_memory=jacobian_memory(n, count),
        )
    max_step = (problem.time_scale or problem.period) / STEPS_PER_PERIOD
    if is_compiled(options):
        return _compiled(automaton, equations, options, max_step)
    return _interpreted(automaton, equations, options, max_step)


def _compiled(
    automaton: Automaton, equations: Equations, options: Options, max_step: float
) -> EngineBinding:
    from mems_impact.hybrid.event_loop import compiled
    from mems_impact.integrators.jit.kernels import observables_of, tangents_of

    try:
        engine = engine_class(options)(equations, options, max_step)
    except Exception as error:  # numba raises various exceptions
        if equations.jacobian is not None:  # the flow may refuse numbers with tangents
            return _compiled(automaton, replace(equations, jacobian=None), options, max_step)
        from mems_impact.hybrid.diagnostics.failures import explain_compile_error

        function_error = explain_compile_error(automaton, error)
        if function_error is None:
            raise
        raise function_error from error

    def call(function: Callable[..., Any], *arguments: Any) -> Any:
        result = compiled.compiled(function)(engine.address, *arguments)
        _raise_fault(engine, automaton)
        return result

    def table(rows: int, width: int) -> Any:
        return np.zeros((rows, max(width, equations.n)))

    def record(dtype: np.dtype[Any], arrays: dict[str, Any], numbers: dict[str, float]) -> Any:
        result = np.zeros(1, dtype=dtype)[0]
        for name, array in arrays.items():
            result[name] = array.ctypes.data
        for name, number in numbers.items():
            result[name] = number
        return result

    def kernel_addresses(
        clock: Any, observe: Any, n: int, count: int
    ) -> tuple[dict[str, Any], Any]:
        kernel = observables_of(observe, n, count) if observe is not None else None
        addresses = {
            "advance": compiled.address_of_loop(clock),
            "observe": kernel.address if kernel is not None else 0,
        }
        return addresses, kernel

    def tangents_reference(tangents: Callable[..., Any], n: int, size: int) -> tuple[int, Any]:
        try:
            kernel = tangents_of(tangents, n, size)
        except Exception as error:  # numba raises various exceptions
            raise FunctionError("an event", f"cannot be compiled: {error}", "") from error
        return kernel.address, kernel

    def array_reference(array: Any) -> int:
        return int(array.ctypes.data)

    return EngineBinding(
        call,
        engine,
        table,
        record,
        StepQuota(100),
        kernel_addresses,
        tangents_reference,
        array_reference,
    )


class _Fields(SimpleNamespace):
    """A record for interpreted code."""

    def __getitem__(self, name: str) -> Any:
        return getattr(self, name)

    def __setitem__(self, name: str, value: Any) -> None:
        setattr(self, name, value)


def _raise_fault(engine: Any, automaton: Automaton) -> None:
    """Raise FunctionError if a function has failed."""
    fault = engine.fault()
    if fault is not None:
        from mems_impact.hybrid.diagnostics.failures import explain_fault

        raise explain_fault(automaton, np.asarray(engine.parameters).tolist(), fault)


def _interpreted(
    automaton: Automaton, equations: Equations, options: Options, max_step: float
) -> EngineBinding:
    engine = engine_class(options)(equations, options, max_step)

    def call(function: Callable[..., Any], *arguments: Any) -> Any:
        result = function(engine, *arguments)
        _raise_fault(engine, automaton)
        return result

    def table(rows: int, width: int) -> Any:
        return [[0.0] * max(width, equations.n) for _ in range(rows)]

    def record(dtype: np.dtype[Any], arrays: dict[str, Any], numbers: dict[str, float]) -> Any:
        # Access to fields of a NumPy record is slow in Python: a third of the run time.
        return _Fields(**{**dict.fromkeys(dtype.names or (), 0), **arrays, **numbers})

    def kernel_addresses(
        _clock: Any, observe: Any, _n: int, _count: int
    ) -> tuple[dict[str, Any], Any]:
        def checked_observe(*arguments: Any) -> int:
            try:
                observe(*arguments)
            except Exception:  # as compiled code does; the caller repeats the call and reports
                return 1
            return 0

        return {"observe": checked_observe}, None

    def tangents_reference(tangents: Callable[..., Any], _n: int, size: int) -> tuple[Any, None]:
        def checked(mode: Any, code: Any, t: float, y: Any, p: Any, out: Any) -> None:
            try:
                tangents(int(mode), int(code), float(t), y, p, out)
            except Exception:  # as compiled code does; calls of the functions themselves report
                out[:size] = math.nan

        return checked, None

    return EngineBinding(
        call,
        engine,
        table,
        record,
        StepQuota(1),
        kernel_addresses,
        tangents_reference,
        lambda array: array,
    )


# --- Memory of the event loop

EVENT_ROWS = 4096  # and one for each guard


class LoopMemory:
    """Clock, table and buffers of the event loop.

    The clock is a record LOOP_STATE; `numbers` are its fields that the problem does not determine.
    The table is an array, or lists for interpreted code.
    """

    def __init__(
        self,
        problem: Problem,
        binding: EngineBinding,
        sample_rows: int,
        **numbers: float,
    ) -> None:
        automaton, options = problem.automaton, problem.options
        n, m = len(automaton.states), len(automaton.guards)
        switches = len(problem.switches)
        self._quota = binding.quota
        section, level, direction = problem.section or (workspace.NONE, 0.0, 0)
        self.table = binding.table(workspace.ROWS, max(n, 2 * m, switches))
        self.events = np.empty((EVENT_ROWS + m, workspace.HEAD + 2 * n))
        self.samples = np.empty((sample_rows, 3 + n))
        for i, values in (*automaton.rows, (workspace.SWITCHES, problem.switches)):
            self.table[i][: len(values)] = values
        self.clock: Any = binding.record(
            workspace.LOOP_STATE,
            {"table": self.table, "events": self.events, "samples": self.samples},
            {
                "width": len(self.table[0]),
                "event_rows": EVENT_ROWS + m,
                "sample_rows": sample_rows,
                "n": n,
                "m": m,
                "switches": switches,
                "modes": len(automaton.modes),
                "forced": int(automaton.forced),
                "clock": workspace.NONE if automaton.clock is None else automaton.clock,
                "period": problem.period,
                "scale": problem.time_scale or problem.period,
                "rtol": options.rtol,
                "atol": options.atol,
                "first_arc": 1,
                "pending_guard": workspace.NONE,
                "stop": np.inf,
                "max_steps": options.max_steps,
                "max_events": options.max_events,
                "section": section,
                "level": level,
                "direction": direction,
                **numbers,
            },
        )

    def put(self, start: HybridState) -> None:
        """Write the state, and which guards wait."""
        self.table[workspace.Y][: len(start.y)] = np.asarray(start.y, dtype=float).tolist()
        for guard in start.waiting:
            if guard < self.clock["m"]:  # the state may be that of another system
                self.table[workspace.WAITING][guard] = 1.0

    @property
    def waiting(self) -> tuple[int, ...]:
        """The guards that wait."""
        flags = self.table[workspace.WAITING][: self.clock["m"]]
        return tuple(guard for guard, flag in enumerate(flags) if flag == 1.0)

    def take_step_collapse(self) -> tuple[HybridState, float] | None:
        """Return the start and length of a step collapse, once; None if there is none."""
        clock, length = self.clock, float(self.clock["collapse_length"])
        if length == 0.0:
            return None
        clock["collapse_length"] = 0.0
        self._quota.discard_growth()  # the loop returns at a collapse
        y = np.array(self.table[workspace.COLLAPSE_STATE][: clock["n"]], dtype=float)
        cycle, mode = int(clock["collapse_cycle"]), int(clock["collapse_mode"])
        return HybridState(cycle, float(clock["collapse_time"]), mode, y), length

    @property
    def local(self) -> Floats:
        """The state with cyclic components relative to their offsets, as functions receive it."""
        return np.array(self.table[workspace.Y][: self.clock["n"]], dtype=float)

    @property
    def state(self) -> Floats:
        """The state, with the offsets of cyclic components added."""
        return self.local + self.table[workspace.OFFSET][: self.clock["n"]]
