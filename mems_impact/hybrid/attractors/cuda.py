"""Mapping of initial conditions to attractors on a GPU, with one point per thread.

A GPU cannot call functions by address. So the texts of `recurrence`, of the event loop and of
DOP853 are compiled for each automaton, with direct calls of its functions, and over the records of
interpreted code, whose arrays become fields. Each thread holds its records in local memory, which
the hardware interleaves: equal words of neighbouring threads are adjacent.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from functools import cache
from types import FunctionType, ModuleType
from typing import Any, cast

import numpy as np
from numba import config, cuda, types

from mems_impact._util.arrays import Floats
from mems_impact.errors import EngineUnavailable
from mems_impact.hybrid.attractors import recurrence
from mems_impact.hybrid.attractors.mapper import AttractorMapper
from mems_impact.hybrid.event_loop import workspace
from mems_impact.integrators import interface
from mems_impact.integrators.dop853 import compiled, stepper
from mems_impact.integrators.jit.closures import (
    Copier,
    Snapshot,
    summarize_numba_error,
    take_snapshot,
)

__all__ = ["GpuMapper"]

THREADS_PER_BLOCK = 32
# Most steps of a point per planned period, ten times those of most points, so that a launch ends.
MAX_STEPS_PER_PERIOD = 250


class GpuMapper:
    """A kernel that maps points of one problem to attractors.

    Parameters
    ----------
    mapper : AttractorMapper
        For the problem with engine "interpreted" and method "dop853".
    """

    def __init__(self, mapper: AttractorMapper) -> None:
        automaton, observed = mapper.problem.automaton, mapper.observed
        engine, clock, self._work = (dict(vars(record)) for record in mapper.records)
        n, m = engine["n"], engine["m"]
        rows = 2 * (workspace.ROOM + m)
        clock = {**clock, "events": clock["events"][:rows], "event_rows": rows}
        self._engine = _record(engine, compiled.HANDLE)
        self._clock = _record(clock, workspace.LOOP_STATE)
        functions = automaton.flow, automaton.margins, automaton.transition, observed.function
        count = len(observed.gains + observed.marks)
        self._functions = take_snapshot(*functions), n, m, count

    def follow(
        self,
        inputs: Floats,
        results: Floats,
        transient: float,
        length: float,
        watch: Callable[[float], None] | None = None,
    ) -> None:
        """Write rows of results of `recurrence`, except those that the GPU cannot complete.

        These are points whose run fails, is stiff, has collapsed steps, or takes too many. A launch
        cannot be watched.

        Raises
        ------
        EngineUnavailable
            If the functions cannot be compiled for a GPU, or the launch fails.
        """
        kernel, records = self.kernel(inputs.shape[1], results.shape[1], transient, length)
        blocks = math.ceil(len(inputs) / THREADS_PER_BLOCK)
        quota = MAX_STEPS_PER_PERIOD * math.ceil(transient + length)
        try:
            kernel[blocks, THREADS_PER_BLOCK](*records, inputs, results, quota)
        except Exception as error:  # numba raises various exceptions
            reason = summarize_numba_error(str(error) or type(error).__name__)
            raise EngineUnavailable(
                f"the GPU cannot run this system: {reason}", "leave executor out"
            ) from error

    def kernel(
        self, input_width: int, result_width: int, transient: float, length: float
    ) -> tuple[Any, list[Floats]]:
        """Return the kernel, and initial records of its threads as words."""
        work = _record(
            {
                **self._work,
                "inputs": np.zeros((1, input_width)),
                "input_width": input_width,
                "results": np.zeros((1, result_width)),
                "result_width": result_width,
                "points": 1,
                "transient": transient,
                "length": length,
            },
            recurrence.WORK,
        )
        records = self._engine, self._clock, work
        kernel = _kernel(*self._functions, *(record.dtype for record in records))
        return kernel, [record.view(np.float64) for record in records]


def _record(values: dict[str, Any], kinds: np.dtype[Any]) -> Any:
    """Return the public fields of an object of interpreted code as an array of one record.

    Lists and arrays become fields; scalars have the types of the fields in `kinds`.
    """
    arrays = {
        name: np.asarray(value)
        for name, value in values.items()
        if not (name.startswith("_") or callable(value))
    }
    fields: list[Any] = []
    for name, value in arrays.items():
        if value.ndim == 0:
            fields.append((name, kinds[name]))
        else:
            number_type = np.int64 if value.dtype.kind == "i" else np.float64
            fields.append((name, number_type, tuple(max(1, size) for size in value.shape)))
    # Fields of this type of record are attributes in Python too, as the simulator requires.
    # Fields without alignment would be read byte by byte.
    record = np.zeros(1, np.dtype((np.record, np.dtype(fields, align=True))))
    for name, value in arrays.items():
        if value.size > 0:
            record[name] = value
    return record


# Functions that return arrays, which a GPU requires to be part of their callers.
VIEWS = (
    stepper.row,
    stepper.component,
    workspace.table_row,
    workspace.event_at,
    workspace.sample_at,
    recurrence.scratch_row,
    recurrence.return_row,
    recurrence.return_statistics,
    recurrence.series_row,
    recurrence.numbers_of,
    recurrence.result_of,
)


LARGE = 300  # bytes of bytecode from which a function is not inlined

# Functions before which the threads of a warp wait for each other. Neighbouring points have like
# motions, and from return to return they compute the same things at about the same time.
CONVERGENT = (recurrence.close_return,)


class _GpuCopier(Copier):
    """Copies functions for a GPU, with other functions in place of some."""

    def __init__(self, substitutes: dict[Any, Any]) -> None:
        super().__init__()
        self._substitutes = substitutes
        self._numpy = ModuleType("numpy")
        vars(self._numpy).update({**vars(np), "nextafter": nextafter})

    def substitute(self, value: Any) -> Any:
        if value is np:
            return self._numpy
        return self._substitutes.get(value, value) if isinstance(value, FunctionType) else value

    def prepare(self, copy: FunctionType, function: FunctionType) -> Any:
        if function in VIEWS:
            return cuda.jit(device=True, inline="always")(copy)
        inner = cuda.jit(device=True)(copy)
        if len(function.__code__.co_code) < LARGE:
            return inner
        name, names = function.__name__, ", ".join(inspect.signature(function).parameters)
        wait = "converge()" if function in CONVERGENT else ""
        space = {"inner": inner, "separate": separate, "converge": converge}
        exec(f"def {name}({names}):\n    separate()\n    {wait}\n    return inner({names})", space)
        return cuda.jit(device=True)(space[name])


if config.ENABLE_CUDASIM:
    nextafter = np.nextafter

    def separate() -> None:
        """Do nothing: Python inlines no functions."""

    def converge() -> None:
        """Do nothing: the simulator has no warps."""

else:
    from numba.cuda import dispatcher
    from numba.cuda.extending import intrinsic

    # A study prepares by a launch of one point.
    dispatcher.config.CUDA_LOW_OCCUPANCY_WARNINGS = 0

    @cuda.jit(device=True)
    def nextafter(x: Any, towards: Any) -> Any:
        """Return the next floating-point number."""
        return cuda.libdevice.nextafter(x, towards)

    @cuda.jit(device=True)
    def converge() -> None:
        """Wait for the threads of the warp that have not ended."""
        cuda.syncwarp()

    @intrinsic
    def separate(_typing: Any) -> Any:
        """Forbid inlining of the calling function, without which a kernel is many times as long."""

        def codegen(context: Any, builder: Any, _signature: Any, _args: Any) -> Any:
            builder.function.attributes.add("noinline")
            return context.get_dummy_value()

        return types.none(), codegen


def _state(engine: Any, y: Any) -> None:
    for i in range(engine.n):
        y[i] = engine.rows[stepper.STATE, i]


METHOD = {
    interface.step: stepper.step,
    interface.restart: stepper.restart,
    interface.reset: stepper.reset,
    interface.interpolate: stepper.interpolate,
    interface.end_margins: compiled.end_margins,
    interface.sharpen: compiled.sharpen,
    interface.method_memory: compiled.method_memory,
    interface.time: lambda engine: engine.t,
    interface.state: _state,
    interface.root_directions: lambda engine, i: engine.crossings[i],
}


def _system(snapshot: Snapshot, n: int, m: int, observables: int) -> dict[Any, Any]:
    """Return what stands for the functions of `interface` that call an automaton's."""
    automaton_flow, automaton_margins, automaton_transition, observed = snapshot.functions

    def flow(engine: Any, mode: int, t: float, y: Any, dy: Any) -> None:
        for i in range(n):
            dy[i] = math.nan  # reveals unwritten components
        automaton_flow(mode, t, y[:n], engine.parameters, dy[:n])

    def margins(engine: Any, mode: int, t: float, y: Any, out: Any) -> None:
        for i in range(2 * m):
            out[i] = 1.0
        automaton_margins(mode, t, y[:n], engine.parameters, out[:m], out[m : 2 * m])

    def transition(engine: Any, mode: int, code: int, t: float, y: Any) -> int:
        return int(automaton_transition(mode, code, t, y[:n], engine.parameters))

    def observe(engine: Any, w: Any, mode: int, code: int, t: float, states: Any, out: Any) -> int:
        observed(mode, code, t, states[: 2 * n], engine.parameters, out[:observables])
        return 0

    return {
        interface.flow: flow,
        interface.margins: margins,
        interface.transition: transition,
        recurrence.observe: observe,
    }


@cache
def _kernel(
    snapshot: Snapshot,
    n: int,
    m: int,
    observables: int,
    engine_kind: np.dtype[Any],
    clock_kind: np.dtype[Any],
    work_kind: np.dtype[Any],
) -> Any:
    """Return the kernel for the functions of an automaton and types of records.

    Its arguments are the three records as words, the inputs and results, with one row per point,
    and the largest number of steps.
    """
    copier = _GpuCopier({**METHOD, **_system(snapshot, n, m, observables)})
    map_points = copier.function(cast(FunctionType, recurrence.map_points))
    done = workspace.DONE
    engine_words, clock_words, work_words = (
        kind.itemsize // 8 for kind in (engine_kind, clock_kind, work_kind)
    )

    def kernel(engines, clocks, works, inputs, results, quota):  # type: ignore[no-untyped-def]
        point = cuda.grid(1)
        if point < inputs.shape[0]:
            engine_memory = cuda.local.array(engine_words, np.float64)
            clock_memory = cuda.local.array(clock_words, np.float64)
            work_memory = cuda.local.array(work_words, np.float64)
            for i in range(engine_words):
                engine_memory[i] = engines[i]
            for i in range(clock_words):
                clock_memory[i] = clocks[i]
            for i in range(work_words):
                work_memory[i] = works[i]
            engine = engine_memory.view(engine_kind)[0]
            clock = clock_memory.view(clock_kind)[0]
            work = work_memory.view(work_kind)[0]
            for i in range(inputs.shape[1]):
                work.inputs[0, i] = inputs[point, i]
            status = map_points(engine, clock, work, quota)
            if status == done and engine.stiff == 0:
                for i in range(results.shape[1]):
                    results[point, i] = work.results[0, i]

    return cuda.jit(kernel)
