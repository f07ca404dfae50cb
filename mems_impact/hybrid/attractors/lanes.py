"""Mapping of initial conditions to attractors in lanes: vectors of several trajectories.

Each *place* has copies of the records of an `AttractorMapper`, and computes one point at a time.
Smooth motion advances in vectors; each lane holds the trajectory of a place
(`integrators.dop853.lanes`). The event loop of a place computes each step with an event, and all
that follows it until the next arc has begun. So each point has the bits of a computation by itself.
A vector contains trajectories of one mode; others wait until most places are in their mode.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import from_dtype

from mems_impact._util.arrays import Floats
from mems_impact.hybrid.attractors.mapper import AttractorMapper
from mems_impact.hybrid.attractors.recurrence import (
    FAILED,
    STROBOSCOPIC,
    UNDECIDED,
    advance_point,
    scratch_row,
    start_point,
    write_result,
)
from mems_impact.hybrid.attractors.recurrence import SIZES as LARGEST
from mems_impact.hybrid.attractors.recurrence import WORK as WORK_RECORD
from mems_impact.hybrid.event_loop.compiled import compiled
from mems_impact.hybrid.event_loop.event_detection import RATE_CHANGE_DECAY, TINY_BIAS
from mems_impact.hybrid.event_loop.loop import (
    COLLAPSE_RATIO,
    REBASE_PERIODS,
    RECENT_STEP_DECAY,
    SWITCH_RTOL,
    begin_arc,
    sample_due,
    sample_time,
)
from mems_impact.hybrid.event_loop.workspace import (
    BELOW_ZERO,
    CYCLIC,
    DONE,
    LOOP_STATE,
    MARGINS_AFTER,
    NONE,
    PAUSED,
    RATE_CHANGE,
    ROOM,
    Y,
    table_row,
)
from mems_impact.hybrid.problem import StepQuota
from mems_impact.integrators import interface
from mems_impact.integrators.auto import stiffness
from mems_impact.integrators.auto.compiled import HANDLE as AUTO_RECORD
from mems_impact.integrators.dop853 import lanes, stepper
from mems_impact.integrators.dop853.compiled import HANDLE as EXPLICIT_RECORD
from mems_impact.integrators.dop853.compiled import begin
from mems_impact.integrators.dop853.lanes import LANE_ENGINE, advance_lanes, attempt_step
from mems_impact.integrators.dop853.stepper import END, HIGH, LOW, START, STATE, ULP, component, row
from mems_impact.integrators.jit.kernels import ENGINE as ENGINE_RECORD
from mems_impact.integrators.jit.lane_kernels import lane_kernels
from mems_impact.integrators.jit.lanes import LANES, count_lanes, first_lane
from mems_impact.integrators.jit.numba_support import WORD, pointer, record_at, words

# --- Places and lanes

# State of a place: its point waits for the event loop, for a lane, is in a lane; or all points
# are complete.
SERVED, READY, LOADED, IDLE = range(4)
# Columns of the places: addresses of the engine, of the engine of DOP853 and of that of `auto` (or
# 0), of the state of the event loop and of WORK; condition.
ENGINE, EXPLICIT, AUTO, CLOCK, WORK, CONDITION, COLUMNS = range(7)

GROUP = np.dtype(
    [
        ("places", np.int64),  # address of rows of integers
        ("count", np.int64),  # number of places
        ("ready", np.int64),  # addresses of the number of ready places by mode
        ("modes", np.int64),
        ("lanes", np.int64),  # address of the place of each lane, or NONE
        ("active", np.int64),  # lanes in use, by bits
        ("next_point", np.int64),
        ("points", np.int64),
        ("completed", np.int64),
        ("plain_steps", np.int64),  # in all lanes
    ],
    align=True,
)
FEWEST_LANES = LANES - 2  # below this, places of a fuller mode take the lanes


_engine_at, auto_at = record_at(from_dtype(ENGINE_RECORD)), record_at(from_dtype(AUTO_RECORD))
_explicit_at = record_at(from_dtype(EXPLICIT_RECORD))
_clock_at = record_at(from_dtype(LOOP_STATE))
_work_at = record_at(from_dtype(WORK_RECORD))


def place_at(group: Any, i: int) -> Any:
    """Return the columns of place `i`."""
    return words(group.places + WORD * COLUMNS * i)


def engine_of(place: Any) -> Any:
    """Return the engine of a place."""
    return _engine_at(place[ENGINE])


def explicit_of(place: Any) -> Any:
    """Return the engine of DOP853 of a place."""
    return _explicit_at(place[EXPLICIT])


def clock_of(place: Any) -> Any:
    """Return the state of the event loop of a place."""
    return _clock_at(place[CLOCK])


def work_of(place: Any) -> Any:
    """Return the record of `recurrence` of a place."""
    return _work_at(place[WORK])


def map_lanes(group: Any, vector: Any, quota: int) -> int:
    """Compute points until all are complete, or the quota of steps is used up.

    Parameters
    ----------
    group, vector : records
        GROUP, and LANE_ENGINE of `integrators.dop853.lanes`.
    quota : int

    Returns
    -------
    int
        DONE or PAUSED.
    """
    while quota > 0:
        for i in range(group.count):
            if place_at(group, i)[CONDITION] == SERVED:
                quota = serve(group, place_at(group, i), quota)
        if group.active == 0:
            mode = fullest_mode(group)
            if words(group.ready)[mode] == 0:
                return PAUSED if quota <= 0 else DONE
            vector.mode = mode
            fill_lanes(group, vector)
        while group.active != 0 and quota > 0:
            attempt_step(vector, group.active)
            group.plain_steps += count_lanes(vector.plain)
            quota -= 1
            leaving, kept, due = group.active & ~(vector.plain | vector.rejected), 0, vector.due
            while due != 0:
                lane = first_lane(due)
                due &= due - 1
                place = place_at(group, words(group.lanes)[lane])
                check_lane(vector, lane, place)
                if changes_method(place[AUTO]):
                    # A single run continues the point.
                    work_of(place).begun = 0
                    place[CONDITION] = SERVED
                    quota = serve(group, place, quota)
                    load_next(group, vector, lane, words(group.lanes)[lane])
            while leaving != 0:
                lane = first_lane(leaving)
                leaving &= leaving - 1
                place = place_at(group, words(group.lanes)[lane])
                complete = (vector.complete >> lane) & 1
                unload_lane(vector, lane, place, complete)
                s, w = clock_of(place), work_of(place)
                point, arc = w.point, s.arcs
                quota = serve(group, place, quota)
                ahead = pointer(vector.numbers)[LANES * lanes.AHEAD + lane]
                if (
                    complete == 1
                    and place[CONDITION] == READY
                    and w.point == point
                    and s.arcs == arc
                    and explicit_of(place).t_end == ahead
                ):
                    # The arc continues at the end of the step, which is in the lane already.
                    words(group.ready)[vector.mode] -= 1
                    place[CONDITION] = LOADED
                    kept |= 1 << lane
                    load_numbers(vector, lane, place)
                else:
                    load_next(group, vector, lane, words(group.lanes)[lane])
            if kept != 0:
                advance_lanes(vector, kept)
            if count_lanes(group.active) < FEWEST_LANES:
                mode = fullest_mode(group)
                if words(group.ready)[mode] > count_lanes(group.active):
                    empty_lanes(group, vector)
    return PAUSED


def fullest_mode(group: Any) -> int:
    """Return the mode with most places that wait for a lane."""
    best = 0
    for mode in range(1, group.modes):
        if words(group.ready)[mode] > words(group.ready)[best]:
            best = mode
    return best


def fill_lanes(group: Any, vector: Any) -> None:
    """Load places of the mode of the vector."""
    for lane in range(LANES):
        load_next(group, vector, lane, 0)


def load_next(group: Any, vector: Any, lane: int, first: int) -> None:
    """Load a place that waits for a lane of this mode, `first` if it does; or leave it empty."""
    group.active &= ~(1 << lane)
    if words(group.ready)[vector.mode] == 0:
        return
    i = first
    while True:
        place = place_at(group, i)
        if place[CONDITION] == READY and clock_of(place).mode == vector.mode:
            words(group.ready)[vector.mode] -= 1
            place[CONDITION] = LOADED
            words(group.lanes)[lane] = i
            group.active |= 1 << lane
            load_lane(vector, lane, place)
            return
        i = i + 1 if i + 1 < group.count else 0


def empty_lanes(group: Any, vector: Any) -> None:
    """Let all places in lanes wait."""
    while group.active != 0:
        lane = first_lane(group.active)
        group.active &= group.active - 1
        i = words(group.lanes)[lane]
        unload_lane(vector, lane, place_at(group, i), 0)
        place_at(group, i)[CONDITION] = READY
        words(group.ready)[vector.mode] += 1


# --- The event loop of a place


def serve(group: Any, place: Any, quota: int) -> int:
    """Advance the point of a place, or the next one, until it can continue in a lane.

    Return the rest of the quota.
    """
    # The step for which it has left its lane cannot be computed there.
    left_lane = place[CONDITION] == LOADED
    place[CONDITION] = SERVED
    engine, explicit, s, w = (
        engine_of(place),
        explicit_of(place),
        clock_of(place),
        work_of(place),
    )
    while True:
        if w.begun == 0:
            if group.next_point >= group.points:
                place[CONDITION] = IDLE
                return quota
            w.point = group.next_point
            group.next_point += 1
            start_point(engine, s, w)
        if not left_lane and can_load(engine, explicit, s):
            place[CONDITION] = READY
            words(group.ready)[s.mode] += 1
            return quota
        if quota <= 0 and not left_lane:
            return quota
        left_lane = False
        advance_point(engine, s, w)
        quota -= 1
        # A single run reports failures and collapsed steps, and continues stiff motions.
        left = s.collapse_length > 0.0 or w.outcome == FAILED or changes_method(place[AUTO])
        if w.outcome != UNDECIDED and not left:
            write_result(engine, s, w)
            group.completed += 1
        if w.outcome != UNDECIDED or left:
            w.begun = 0


def changes_method(auto: int) -> bool:
    """Return whether `auto` has found a stiff motion."""
    return auto != 0 and (auto_at(auto).wanted == 1 or auto_at(auto).now != stiffness.EXPLICIT)


def can_load(engine: Any, explicit: Any, s: Any) -> bool:
    """Begin an arc that is due; return whether its next step may be computed in a lane."""
    if s.first_arc == 1 or s.pending_guard != NONE:
        return False
    if s.restart == 1:
        begin_arc(engine, s, table_row(s, Y))
    if explicit.begun == 0 and begin(explicit) < 0:
        return False
    if (
        explicit.rest == 1
        or s.step_cut == 1
        or s.starts_negative == 1
        or s.negative_by_error == 1
        or steps_before_check(explicit) == 0
        or s.max_steps - s.arc_steps <= stepper.CHECK_INTERVAL
    ):
        return False
    for k in range(s.m):
        if interface.bias(engine, k) > TINY_BIAS or table_row(s, BELOW_ZERO)[k] != 0.0:
            return False
    return True


def steps_before_check(explicit: Any) -> int:
    """Return the number of steps before the next one whose stability is checked."""
    if explicit.at_border != 0:
        return 0
    return stepper.CHECK_INTERVAL - 1 - explicit.steps % stepper.CHECK_INTERVAL


def steps_to_check(auto: Any) -> int:
    """Return the number of steps up to the next check of stiffness."""
    return stiffness.CHECK_INTERVAL - auto.steps % stiffness.CHECK_INTERVAL


def check_lane(vector: Any, lane: int, place: Any) -> None:
    """Let `auto` check the stiffness of the motion in a lane."""
    auto, y = auto_at(place[AUTO]), stiffness.row(auto_at(place[AUTO]), stiffness.STATE)
    rows, x = pointer(vector.rows), pointer(vector.numbers)
    for j in range(vector.n):
        y[j] = rows[LANES * (START * vector.width + j) + lane]
    auto.steps += steps_to_check(auto)
    x[LANES * lanes.UNCHECKED + lane] = stiffness.CHECK_INTERVAL
    stiffness.check_stiffness(auto, x[LANES * lanes.T + lane], explicit_of(place).longest)


# --- Exchange with lanes


def load_lane(vector: Any, lane: int, place: Any) -> None:
    """Copy the arc of a place, which begins its next step, to a lane."""
    explicit, s = explicit_of(place), clock_of(place)
    n, m, width = s.n, s.m, vector.width
    rows, components = pointer(vector.rows), pointer(vector.components)
    for j in range(n):
        rows[LANES * (START * width + j) + lane] = row(explicit, END)[j]
        components[LANES * stepper.ENGINE_NUMBERS * j + lane] = component(explicit, j)[12]
    for k in range(m):
        rows[LANES * (lanes.BIAS * width + k) + lane] = pointer(explicit.bias)[k]
    for k in range(2 * m):
        rows[LANES * (LOW * width + k) + lane] = row(explicit, LOW)[k]
    for k in range(explicit.parameter_count):
        pointer(vector.parameters)[LANES * k + lane] = pointer(explicit.parameters)[k]
    load_numbers(vector, lane, place)


def load_numbers(vector: Any, lane: int, place: Any) -> None:
    """Copy the step size control of a place, and the bounds of its next steps, to a lane."""
    explicit, s, w = explicit_of(place), clock_of(place), work_of(place)
    rows, width = pointer(vector.rows), vector.width
    for j in range(s.n):
        rows[LANES * (lanes.SIZES * width + j) + lane] = scratch_row(w, LARGEST)[j]
    for k in range(s.m):
        rows[LANES * (lanes.RATE_CHANGE * width + k) + lane] = table_row(s, RATE_CHANGE)[k]
    limit = min((s.end_cycle - s.cycle) * s.period + s.end_phase, REBASE_PERIODS * s.period)
    limit = min(limit, s.stop - 2.0 * SWITCH_RTOL * s.period)  # an instant near it is the switch
    if sample_due(s):
        limit = min(limit, sample_time(s))
    t = explicit.t_end
    smallest = 4.0 * ULP * max(abs(t), explicit.max_step)
    x = pointer(vector.numbers)
    x[LANES * lanes.T + lane] = t
    x[LANES * lanes.TRIAL + lane] = max(min(explicit.h_next, explicit.longest), smallest)
    x[LANES * lanes.NEXT + lane] = explicit.h_next
    x[LANES * lanes.LONGEST + lane] = explicit.longest
    x[LANES * lanes.MAX_STEP + lane] = explicit.max_step
    x[LANES * lanes.STOP + lane] = explicit.stop
    x[LANES * lanes.LIMIT + lane] = limit
    x[LANES * lanes.RECENT + lane] = s.recent_step
    x[LANES * lanes.REJECTED + lane] = 0.0
    x[LANES * lanes.LEFT + lane] = steps_before_check(explicit)
    x[LANES * lanes.TAKEN + lane] = 0.0
    unchecked = math.inf
    if place[AUTO] != 0:
        unchecked = steps_to_check(auto_at(place[AUTO]))
    x[LANES * lanes.UNCHECKED + lane] = unchecked
    x[LANES * lanes.SEARCH + lane] = engine_of(place).approach_search


def unload_lane(vector: Any, lane: int, place: Any, complete: int) -> None:
    """Copy a lane to the arc of its place, with the last step if that is `complete`."""
    explicit, s, w = explicit_of(place), clock_of(place), work_of(place)
    n, m, width = s.n, s.m, vector.width
    rows, components = pointer(vector.rows), pointer(vector.components)
    x = pointer(vector.numbers)
    t, taken = x[LANES * lanes.T + lane], int(x[LANES * lanes.TAKEN + lane])
    for j in range(n):
        y = rows[LANES * (START * width + j) + lane]
        row(explicit, START)[j] = y
        row(explicit, STATE)[j] = y
        row(explicit, END)[j] = y
        table_row(s, Y)[j] = y
        component(explicit, j)[12] = components[LANES * stepper.ENGINE_NUMBERS * j + lane]
        if table_row(s, CYCLIC)[j] == 0.0:
            scratch_row(w, LARGEST)[j] = rows[LANES * (lanes.SIZES * width + j) + lane]
    for k in range(m):
        table_row(s, RATE_CHANGE)[k] = rows[LANES * (lanes.RATE_CHANGE * width + k) + lane]
    for k in range(2 * m):
        low = rows[LANES * (LOW * width + k) + lane]
        row(explicit, LOW)[k] = low
        table_row(s, MARGINS_AFTER)[k] = low
    row(explicit, LOW)[2 * m] = 1.0
    if taken > 0:
        s.switched = 0
    s.t = t
    s.steps += taken
    s.arc_steps += taken
    s.recent_step = x[LANES * lanes.RECENT + lane]
    explicit.steps += taken
    explicit.t = t
    explicit.t_end = t
    explicit.t_start = t
    explicit.h_next = x[LANES * lanes.NEXT + lane]
    if place[AUTO] != 0:
        auto = auto_at(place[AUTO])
        auto.steps += steps_to_check(auto) - int(x[LANES * lanes.UNCHECKED + lane])
    if complete == 1:
        total = 0.0
        for j in range(n):
            row(explicit, stepper.ARGUMENT)[j] = rows[LANES * j + lane]
            row(explicit, END)[j] = rows[LANES * (END * width + j) + lane]
            k = component(explicit, j)
            for i in range(11, stepper.ENGINE_NUMBERS - 1):
                k[i] = components[LANES * (stepper.ENGINE_NUMBERS * j + i) + lane]
                total += k[i]
        for k in range(2 * m):
            row(explicit, HIGH)[k] = rows[LANES * (HIGH * width + k) + lane]
        row(explicit, HIGH)[2 * m] = 1.0
        explicit.has_dense = int(math.isfinite(total))
        if explicit.has_dense == 0:
            # The engine computes it from the stages, and records a fault of the flow.
            for j in range(n):
                for i in range(11):
                    number = components[LANES * (stepper.ENGINE_NUMBERS * j + i) + lane]
                    component(explicit, j)[i] = number
        explicit.rest = 1
        stepper.accept_step(
            explicit,
            t,
            x[LANES * lanes.AHEAD + lane],
            x[LANES * lanes.TRIAL + lane],
            x[LANES * lanes.ERROR + lane],
            x[LANES * lanes.REJECTED + lane] > 0.5,
        )


# --- Interface

PLACES = 8 * LANES  # places of a group
FIRST_QUOTA = 1_000  # steps


def lane_mappers(mapper: AttractorMapper) -> list[LaneMapper]:
    """Return a `LaneMapper` for a compiled mapper; none if its points cannot be mapped in lanes."""
    _, clock, work = mapper.records
    method = mapper.problem.options.method
    if method not in ("auto", "dop853") or work["return_kind"] != STROBOSCOPIC:
        return []
    automaton = mapper.problem.automaton
    kernels = lane_kernels(automaton.flow, automaton.margins, int(clock["n"]), int(clock["m"]))
    return [] if kernels is None else [LaneMapper(mapper, kernels)]


class LaneMapper:
    """Maps points of one problem to attractors in lanes.

    Parameters
    ----------
    mapper : AttractorMapper
        For the problem, compiled, with method "auto" or "dop853".
    kernels : LaneKernels

    Attributes
    ----------
    group : GROUP
    """

    def __init__(self, mapper: AttractorMapper, kernels: Any) -> None:
        engine, clock, _ = mapper.records
        explicit: Any = getattr(engine, "explicit", engine)  # of `auto`
        self._mapper, self._kernels = mapper, kernels
        n, m = int(clock["n"]), int(clock["m"])
        count = int(explicit.handle["parameter_count"])
        width = max(n, 2 * m)
        sizes = {
            "rows": lanes.ROWS * width,
            "components": n * stepper.ENGINE_NUMBERS,
            "numbers": lanes.NUMBERS,
            "parameters": count,
            "argument_time": 1,
        }
        self._vectors = _aligned(sum(sizes.values()) * LANES)
        self._vector = np.zeros(1, LANE_ENGINE)[0]
        place = self._vectors.ctypes.data
        for name, size in sizes.items():
            self._vector[name] = place
            place += WORD * LANES * size
        for name, value in {
            "flow": kernels.flow.address,
            "margins": kernels.margins.address,
            "approaches": explicit.handle["approaches"],
            "width": width,
            "n": n,
            "m": m,
            "parameter_count": count,
            "rtol": clock["rtol"],
            "atol": clock["atol"],
            "last_instant": np.inf,
            "collapse_ratio": COLLAPSE_RATIO,
            "recent_step_decay": RECENT_STEP_DECAY,
            "rate_change_decay": RATE_CHANGE_DECAY,
        }.items():
            self._vector[name] = value
        self._places = np.zeros((PLACES, COLUMNS), np.int64)
        self._memories = self._fill_places(engine, explicit)
        self._ready = np.zeros(int(clock["modes"]), np.int64)
        self._lanes = np.full(LANES, NONE)
        self.group = np.zeros(1, GROUP)[0]
        for name, array in (
            ("places", self._places), ("ready", self._ready), ("lanes", self._lanes)
        ):  # fmt: skip
            self.group[name] = array.ctypes.data
        self.group["modes"] = clock["modes"]

    def _fill_places(self, engine: Any, explicit: Any) -> Any:
        """Copy all records of the mapper for each place; return the memory of the copies."""
        _, clock, work = self._mapper.records
        loop, memory = self._mapper.loop, self._mapper.memory
        rows = 2 * (ROOM + int(clock["m"]))
        blocks = {
            "clock": (_address(clock), clock.dtype.itemsize),
            "work": (_address(work), work.dtype.itemsize),
            "table": (loop.table.ctypes.data, loop.table.nbytes),
            "events": (loop.events.ctypes.data, loop.events[:rows].nbytes),
            "samples": (loop.samples.ctypes.data, loop.samples.nbytes),
            "memory": (memory.ctypes.data, memory.nbytes),
        }
        engines = {"explicit": explicit}
        if engine is not explicit:
            engines["auto"] = engine
        for name, each in engines.items():
            blocks[name] = each.address, each.handle.dtype.itemsize
            blocks[f"{name} memory"] = each.memory.ctypes.data, each.memory.nbytes
        sizes = [size // WORD for _, size in blocks.values()]
        starts = dict(zip(blocks, np.cumsum([0, *sizes]).tolist(), strict=False))
        copies = np.tile(
            np.concatenate([_memory(*block, np.int64) for block in blocks.values()]), (PLACES, 1)
        )
        begins = copies.ctypes.data + WORD * copies.shape[1] * np.arange(PLACES)
        for record in ("clock", "work", *engines):
            words = _memory(*blocks[record], np.int64)
            for name, (first, size) in blocks.items():
                inside = np.flatnonzero((words >= first) & (words < first + max(size, 1)))
                moved = words[inside] - first + WORD * starts[name]
                copies[:, starts[record] + inside] = begins[:, np.newaxis] + moved
        at = {name: begins + WORD * starts[name] for name in ("clock", "work", *engines)}
        for address in at["clock"].tolist():
            _record_at(address, LOOP_STATE)["event_rows"] = rows
        self._places[:, EXPLICIT], self._places[:, AUTO] = at["explicit"], at.get("auto", 0)
        self._places[:, ENGINE] = at.get("auto", at["explicit"])
        self._places[:, CLOCK], self._places[:, WORK] = at["clock"], at["work"]
        return copies

    def follow(
        self,
        inputs: Floats,
        results: Floats,
        transient: float,
        length: float,
        watch: Callable[[float], None] | None = None,
    ) -> None:
        """Write rows of results of `recurrence`, except those that are left to single runs.

        These are points whose run fails, is stiff or has collapsed steps.
        """
        group = self.group
        group["count"] = min(PLACES, len(inputs))
        group["points"], group["next_point"], group["completed"] = len(inputs), 0, 0
        group["active"] = group["plain_steps"] = 0
        self._ready[:] = 0
        self._places[:, CONDITION] = SERVED
        for place in self._places:
            work = _record_at(int(place[WORK]), WORK_RECORD)
            work["inputs"], work["input_width"] = inputs.ctypes.data, inputs.shape[1]
            work["results"], work["result_width"] = results.ctypes.data, results.shape[1]
            work["begun"], work["transient"], work["length"] = 0, transient, length
        status, quota = PAUSED, StepQuota(FIRST_QUOTA)
        while status != DONE:
            status = quota.call(compiled(map_lanes), group, self._vector)
            if watch is not None:
                watch(float(group["completed"]))


def _address(record: Any) -> int:
    return int(record.__array_interface__["data"][0])


def _memory(address: int, size: int, kind: Any) -> Any:
    block: Any = (ctypes.c_char * size).from_address(address)
    return np.frombuffer(block, kind)


def _record_at(address: int, kind: Any) -> Any:
    return _memory(address, kind.itemsize, kind)[0]


def _aligned(count: int) -> Any:
    """Return zeros that begin at a multiple of the size of a vector."""
    block = np.zeros(count + LANES)
    begin = -(block.ctypes.data // WORD) % LANES
    return block[begin : begin + count]
