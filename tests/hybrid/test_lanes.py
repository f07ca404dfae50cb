"""Lanes: vectors of trajectories have the bits of single ones."""

import math

import numpy as np
import pytest
from numba import njit, types
from numba.core.errors import NumbaError

import mems_impact as mi
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis import attractor
from mems_impact.analysis.attractor import InitialCondition, map_attractors
from mems_impact.hybrid import problem
from mems_impact.hybrid.attractors import lanes
from mems_impact.integrators.jit import lane_kernels as lane_kernels_module
from mems_impact.integrators.jit.closures import take_snapshot
from mems_impact.integrators.jit.if_conversion import LaneCompiler
from mems_impact.integrators.jit.kernel_code import compile_kernel
from mems_impact.integrators.jit.lane_kernels import (
    LaneCopier,
    LaneKernelCode,
    call_lane_kernel,
    lane_kernels,
)
from mems_impact.integrators.jit.lanes import LANES, Lanes, LaneVector

POINTS = 24
MANY = 128
BRIEF = mi.RecurrenceOptions(periods=20, transient=60, exponents="none")

# --- Arithmetic

SPECIAL = (
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.3,
    -2.7,
    1e-310,
    1e10,
    -3e9,
    700.0,
    math.inf,
    -math.inf,
    math.nan,
)


def unary(mode, t, y, p, out):
    x = y[0]
    out[0] = math.sin(x)
    out[1] = math.cos(x)
    out[2] = math.tanh(x)
    out[3] = math.exp(x)
    out[4] = math.sqrt(x)
    out[5] = abs(x)
    out[6] = -x
    out[7] = x**2
    out[8] = (abs(x) + 0.1) ** -3
    out[9] = 2 - 1 / (3 + x)  # a number first


def binary(mode, t, y, p, out):
    x, z = y[0], y[-1]
    out[0] = min(x, z)
    out[1] = max(x, z)
    out[2] = math.copysign(x, z)
    out[3] = math.atan2(x, z)
    out[4] = math.pow(abs(x), z)
    out[5] = x * z + z * z - x
    out[6] = x / z


def aligned(rows):
    return lanes._aligned(rows * LANES).reshape(rows, LANES)


@njit
def call(kernel, mode, t, y, p, size, out):
    return call_lane_kernel(kernel, (mode, t, y, p, size, out))


def in_lanes(function, states, outputs=1):
    """Return the outputs, in rows, of ``function(mode, t, y, p, out)`` of states in columns."""
    kinds = types.int64, Lanes, LaneVector, LaneVector, LaneVector
    snapshot = take_snapshot(function)

    def body(code):
        state = code.vector(code.y, code.count(len(states)))
        out, p = code.vector(code.out, code.count(outputs)), code.vector(code.parameters, code.size)
        with code.call(code.mode, code.t, state, p, out):
            code.fill(code.out, outputs, math.nan)
        return code.either(if_failed=1, if_successful=0)

    kernel = compile_kernel(
        lambda: snapshot.frozen_by(LaneCopier(pipeline_class=LaneCompiler))[0],
        kinds,
        body,
        f"test_{snapshot.name}",
        False,
        LaneKernelCode,
        pipeline_class=LaneCompiler,
    )
    count = states.shape[1]
    y, time, out, found = aligned(len(states)), aligned(1), aligned(outputs), []
    for first in range(0, count, LANES):
        part = states[:, first : first + LANES]
        y[:, : part.shape[1]] = part
        addresses = (each.ctypes.data for each in (time, y, time))
        call(kernel.address, 0, *addresses, 1, out.ctypes.data)
        found.append(out[:, : part.shape[1]].copy())
    return np.concatenate(found, axis=1)


def check_bits(function, states, outputs=1):
    (frozen,) = take_snapshot(function).frozen()
    compiled, found = njit(error_model="numpy")(frozen), np.zeros((outputs, states.shape[1]))
    for column, out in zip(states.T, found.T, strict=True):
        compiled(0, 0.0, np.ascontiguousarray(column), np.zeros(1), out)
    np.testing.assert_array_equal(in_lanes(function, states, outputs), found)


def test_functions_of_a_vector_have_the_bits_of_those_of_numbers():
    near = np.random.default_rng(1).normal(scale=30.0, size=40)
    check_bits(unary, np.array([[*SPECIAL, *near]]), outputs=10)


def test_functions_of_two_vectors_have_the_bits_of_those_of_numbers():
    x, y = np.meshgrid(SPECIAL, SPECIAL)
    check_bits(binary, np.array([x.ravel(), y.ravel()]), outputs=7)


def test_whole_parts():
    def function(mode, t, y, p, out):
        out[0] = math.floor(y[0]) + 10 * math.ceil(y[0]) + 100 * math.trunc(y[0])

    states = np.array([[-2.7, -2.0, -0.3, 0.0, 0.3, 1.0, 1e9 + 0.5]])
    check_bits(function, states)


# --- Branches


def conditional(x, y, mode):
    return (x if x > y else -y) * (2.0 if mode == 0 else 3.0)


def alternatives(x, y, mode):
    size = x
    if x > 1.0:
        size = math.sqrt(x)
        limit = y
    elif x > 0.0:
        limit = 2.0
    else:
        limit = size * y
    return size - limit


def early_return(x, y, mode):
    if abs(x) > 2.0:
        return math.copysign(2.0, x)
    scaled = x / (abs(y) + 1.0)
    return scaled if mode == 0 else y


def nested(x, y, mode):
    if x > 0.0:
        found = y if y > 0.0 else -2.0 * y
    else:
        found = 1.0
        if y != 0.0:
            found = x / y
    return found


def one_sided(x, y, mode):
    if x < y:
        x = 0.5 * (x + y)
    return x


def several(x, y, mode):
    low, high = (x, y) if x < y else (y, x)
    return high - 3.0 * low


def excluded(x, y, mode):
    return math.log(x) if x > 0.0 else y


def both(x, y, mode):
    return x if x > 0.0 and y > 0.0 else y - x


def chained(x, y, mode):
    return x if -1.0 < x < 1.0 else y


def converted(mode, t, y, p, out):
    x, z = y[0], y[1]
    out[0] = conditional(x, z, mode)
    out[1] = alternatives(x, z, mode)
    out[2] = early_return(x, z, mode)
    out[3] = nested(x, z, mode)
    out[4] = one_sided(x, z, mode)
    out[5] = several(x, z, mode)
    out[6] = excluded(x, z, mode)


def repeated(x, y, mode):
    count = 0
    while abs(x) > 1.0 and count < 5:
        x = 0.5 * x
        count += 1
    return x + count * y


def is_above(x, y):
    return x > y


def limited(x, y):
    """Return two numbers, after a loop."""
    for _ in range(3):
        if x > y:
            x = x - 1.0
    return x, y


def by_helpers(x, y, mode):
    a, b = limited(x, y)
    return a - b if is_above(x, y) else b


def raising(x, y, mode):
    if x > 1e300:
        raise ValueError
    return x


def by_lane(mode, t, y, p, out):
    x, z = y[0], y[1]
    out[0] = both(x, z, mode)
    out[1] = chained(x, z, mode)
    out[2] = repeated(x, z, mode)
    out[3] = by_helpers(x, z, mode)
    out[4] = raising(x, z, mode)


PAIRS = np.array(
    [each.ravel() for each in np.meshgrid(*2 * [[x for x in SPECIAL if abs(x) < 1e300]])]
)


def test_functions_that_branch_have_the_bits_of_those_of_numbers():
    check_bits(by_lane, PAIRS, outputs=5)


def test_a_branch_that_only_computes_becomes_a_selection(monkeypatch):
    def refused(*_):
        raise AssertionError

    monkeypatch.setattr(lane_kernels_module, "scalar_kind", refused)
    check_bits(converted, PAIRS, outputs=7)


def test_a_branch_on_the_mode_remains_a_branch():
    def function(mode, t, y, p, out):
        out[0] = y[0] if mode == 0 else y[9]  # an index out of range

    check_bits(function, np.ones((2, LANES)))


def test_a_condition_without_a_selection_is_refused():
    def function(mode, t, y, p, out):
        while y[0] > out[0]:
            out[0] += 1.0

    with pytest.raises(NumbaError):
        in_lanes(function, np.ones((2, LANES)))


def test_a_fault_in_one_lane_is_a_fault_of_the_vector():
    def function(mode, t, y, p, out):
        out[0] = raising(y[0], y[1], mode)

    states = np.array([[0.0, 1e308, *[1.0] * (LANES - 2)], [0.0] * LANES])
    assert np.isnan(in_lanes(function, states)).all()


def test_an_index_out_of_range_is_an_error():
    def function(mode, t, y, p, out):
        out[0] = y[len(y) + mode]

    assert np.isnan(in_lanes(function, np.ones((2, LANES)))).all()


def test_a_part_of_an_array_begins_and_ends_as_in_python():
    def function(mode, t, y, p, out):
        part = y[1:-1]
        out[0] = part[0] + 10 * part[-1] + 100 * len(part)

    states = np.arange(5.0)[:, None] * np.ones(LANES)
    assert in_lanes(function, states).tolist() == [[331.0] * LANES]


# --- Systems


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - p.k * y.x - p.cubic * y.x**3 - p.c * math.tanh(y.v)


def gap(mode, t, y, p):
    return p.d - y.x


def rebound(mode, t, y, p):
    return mode, (p.d, -p.e * y.v)


OSCILLATOR = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={
        "c": 0.1, "k": 1.0, "cubic": 0.1, "d": 1.0, "e": 0.8, "A": 0.6, "omega": 0.8,
    },
    guards=[mi.Impact("stop", gap, rebound)],
)  # fmt: skip


def array_flow(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[-1] = p.A * math.cos(p.omega * t) - y[0] - 0.1 * y[1]


def array_rebound(mode, t, y, p, new):
    new[0] = p.d
    new[1] = -0.8 * y[1]
    return mode


ARRAYS = mi.System(
    states=("x", "v"),
    flow=array_flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"d": 0.6, "A": 0.6, "omega": 0.8},
    guards=[mi.Impact("stop", lambda mode, t, y, p: p.d - y[0], array_rebound)],
)


FORWARD, BACKWARD = mi.modes("forward", "backward")


def switched_flow(mode, t, y, p):
    drive = p.A if mode == FORWARD else -p.A
    return y.v, drive - y.x - 0.1 * y.v


SWITCHED = mi.System(
    states=("x", "v"),
    flow=switched_flow,
    modes=(FORWARD, BACKWARD),
    period=lambda p: 2.0 * math.pi / p.omega,
    switches=lambda p: (math.pi / p.omega, 2.0 * math.pi / p.omega),
    switch_transition=lambda mode, t, y, p: (BACKWARD if mode == FORWARD else FORWARD, (y.x, y.v)),
    parameters={"d": 0.6, "A": 0.6, "omega": 0.8},
    guards=[mi.Impact("stop", gap, lambda mode, t, y, p: (mode, (p.d, -0.8 * y.v)))],
)


def branching_flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - (2.0 if y.x > 0.0 else 1.0) * y.x - 0.1 * y.v


BILINEAR = mi.System(
    states=("x", "v"),
    flow=branching_flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"d": 0.6, "A": 0.6, "omega": 0.8},
    guards=[mi.Impact("stop", gap, lambda mode, t, y, p: (mode, (p.d, -0.8 * y.v)))],
)


def push_of(depth, p):
    """Return a force by the first row of a table beyond a depth."""
    i = 0
    while i < len(ROWS) - 1 and depth > ROWS[i + 1][0]:
        i += 1
    start, force, slope = ROWS[i]
    return force + slope * (depth - start)


ROWS = ((-10.0, 0.0, 0.0), (0.0, 0.0, 3.0), (0.2, 0.6, 8.0), (0.5, 3.0, 20.0))
SOFT_STOP = mi.System(
    states=("x", "v"),
    flow=lambda mode, t, y, p: (
        y.v,
        p.A * math.cos(p.omega * t) - y.x - 0.1 * y.v - push_of(y.x - p.d, p),
    ),
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"d": 0.4, "A": 0.6, "omega": 0.8},
    guards=[
        mi.Impact(
            "stop",
            lambda mode, t, y, p: p.d + 0.2 - y.x if y.x > 0.0 else p.d + 0.2,
            lambda mode, t, y, p: (mode, (p.d + 0.2, -0.8 * y.v)),
        )
    ],
)


def branching_array_flow(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = p.A * math.cos(p.omega * t) - y[0] - 0.1 * y[1]
    if y[0] > 0.3:
        dy[1] -= 3.0 * (y[0] - 0.3)


BRANCHING_ARRAYS = mi.System(
    states=("x", "v"),
    flow=branching_array_flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"d": 0.6, "A": 0.6, "omega": 0.8},
    guards=[mi.Impact("stop", lambda mode, t, y, p: p.d - y[0], array_rebound)],
)


AUTONOMOUS = mi.System(
    states=("x", "v"),
    flow=lambda mode, t, y, p: (y.v, -y.x - p.c * y.v),
    parameters={"c": 0.1},
    section=("x", 0.0),
)


def stiff_flow(mode, t, y, p):
    return y.v, p.stiffness * (p.A * math.cos(p.omega * t) - y.x - y.v)


STIFF = mi.System(
    states=("x", "v"),
    flow=stiff_flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"stiffness": 1e5, "d": 5.0, "A": 0.6, "omega": 0.8},
    guards=[mi.Impact("stop", gap, lambda mode, t, y, p: (mode, (p.d, -0.8 * y.v)))],
)


def failing_flow(mode, t, y, p):
    return y.v, math.sqrt(p.A - y.x * y.x) * math.cos(p.omega * t) - y.x - 0.4 * y.v


FAILING = mi.System(
    states=("x", "v"),
    flow=failing_flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"d": 5.0, "A": 40.0, "omega": 0.8},
)


def grid(system, amplitudes=(0.2, 1.6), frequencies=(0.5, 1.6), points=POINTS):
    numbers = np.random.default_rng(3)
    values = zip(
        numbers.uniform(*amplitudes, points), numbers.uniform(*frequencies, points), strict=True
    )
    return [InitialCondition(system.shifted({"A": a, "omega": w})) for a, w in values]


def actuators(waveform=mi.Sine, **others):
    actuator, numbers = mi.load_actuator("zhao2004"), np.random.default_rng(4)
    start = mi.kicked_state(actuator)
    values = zip(numbers.uniform(0.15, 0.4, POINTS), numbers.uniform(0.4, 0.6, POINTS), strict=True)
    return [
        InitialCondition(ActuatorSystem(actuator, waveform(amplitude=a, omega=w, **others)), start)
        for a, w in values
    ]


@pytest.fixture
def mapped(monkeypatch):
    """Return attractors by single runs, those in lanes, and the number of steps in lanes."""
    steps = []

    class Counted(lanes.LaneMapper):
        def follow(self, *given):
            super().follow(*given)
            steps.append(int(self.group["plain_steps"]))

    monkeypatch.setattr(lanes, "LaneMapper", Counted)

    def both(cases, recurrence=BRIEF, **options):
        given = mi.Options(**{"method": "auto", **options})
        monkeypatch.setattr(attractor, "LEAST_LANE_POINTS", 10**9)
        single = map_attractors(cases, recurrence, given)
        monkeypatch.setattr(attractor, "LEAST_LANE_POINTS", 1)
        return single, map_attractors(cases, recurrence, given), sum(steps)

    return both


def content(found):
    at = found.instant
    final = None if at is None else (at.cycle, at.time, at.mode, at.y.tolist())
    return (
        found.motion, found.period, found.returns, found.status, final, repr(found.measures),
        repr(found.exponent), repr(found.states),
    )  # fmt: skip


CASES = {
    "oscillator": lambda: grid(OSCILLATOR),
    "arrays": lambda: grid(ARRAYS),
    "actuator": actuators,
    "switches": lambda: grid(SWITCHED, points=MANY),
}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "dop853"])
@pytest.mark.parametrize("name", CASES)
def test_points_in_lanes_have_the_bits_of_single_runs(mapped, name, method):
    single, together, steps = mapped(CASES[name](), method=method)
    assert steps > 1000
    assert [content(each) for each in together] == [content(each) for each in single]
    assert len({each.returns for each in single}) > 1


@pytest.mark.slow
def test_exponents_and_longer_runs_are_the_same(mapped):
    recurrence = mi.RecurrenceOptions(periods=20, transient=60, chaos_persistence=2)
    single, together, _ = mapped(actuators(), recurrence)
    assert [content(each) for each in together] == [content(each) for each in single]


@pytest.mark.slow
def test_an_orbit_beyond_the_longest_period_is_found(mapped):
    """Its period, of 20 returns, is sought in a second run with a longest period of 64."""

    def flow(mode, t, y, p):
        rate = (1.0 - 0.1 * math.sin(20.0 * math.atan2(y.v, y.u) - t)) / 20.0
        inwards = p.a * (1.0 - y.u * y.u - y.v * y.v)
        return inwards * y.u - rate * y.v, inwards * y.v + rate * y.u

    system = mi.System(
        states=("u", "v"),
        flow=flow,
        parameters={"a": 0.5},
        period=2.0 * math.pi,
        initial={"u": 0.5},
    )
    cases = [InitialCondition(system.shifted({"a": a})) for a in np.linspace(0.3, 0.6, POINTS)]
    recurrence = mi.RecurrenceOptions(periods=20, transient=100, chaos_persistence=2)
    single, together, steps = mapped(cases, recurrence)
    assert steps > 1000
    assert [each.period for each in single] == [20] * POINTS
    assert [content(each) for each in together] == [content(each) for each in single]


@pytest.mark.slow
def test_tight_tolerances(mapped):
    single, together, steps = mapped(grid(OSCILLATOR), method="dop853", rtol=1e-12, atol=1e-14)
    assert steps > 1000
    assert [content(each) for each in together] == [content(each) for each in single]


@pytest.mark.slow
def test_stiff_motions_are_left_to_single_runs(mapped):
    single, together, _ = mapped(grid(STIFF))
    assert [content(each) for each in together] == [content(each) for each in single]
    assert {each.motion for each in single} <= {"periodic", "off"}


@pytest.mark.slow
def test_failures_are_left_to_single_runs(mapped):
    single, together, _ = mapped(grid(FAILING, (0.5, 40.0)))
    assert [content(each) for each in together] == [content(each) for each in single]
    assert 0 < sum(each.motion == "failed" for each in single) < POINTS


@pytest.mark.slow
def test_a_fault_in_the_dense_output_is_a_failure(mapped):
    """Of some points only stages of the dense output leave the domain of the flow."""

    def flow(mode, t, y, p):
        if y.x > 1.2:
            raise ValueError("too far")
        return y.v, p.A * math.cos(p.omega * t) - y.x - 0.1 * y.v

    system = mi.System(
        states=("x", "v"),
        flow=flow,
        period=lambda p: 2.0 * math.pi / p.omega,
        parameters={"A": 0.6, "omega": 0.8},
    )
    single, together, _ = mapped(grid(system, (0.05, 3.0), (0.3, 2.5), 2000))
    assert [content(each) for each in together] == [content(each) for each in single]
    assert 0 < sum(each.motion == "failed" for each in single) < 2000


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bilinear", "soft stop", "arrays", "waveform"])
def test_functions_that_branch_on_the_state_have_the_bits_of_single_runs(mapped, name):
    systems = {"bilinear": BILINEAR, "soft stop": SOFT_STOP, "arrays": BRANCHING_ARRAYS}
    cases = grid(systems[name]) if name in systems else actuators(mi.Square, rise=0.3)
    single, together, steps = mapped(cases)
    assert steps > 400
    assert [content(each) for each in together] == [content(each) for each in single]


def test_a_function_without_a_caller_cannot_be_computed_lane_by_lane():
    def flow(mode, t, y, p, dy):
        dy[0] = 1.0
        while dy[0] < y[0]:
            dy[0] += 1.0

    assert lane_kernels(flow, OSCILLATOR.automaton.margins, 2, 1) is None


@pytest.mark.slow
def test_an_interrupted_map_can_be_repeated(monkeypatch):
    monkeypatch.setattr(attractor, "LEAST_LANE_POINTS", 1)
    monkeypatch.setattr(lanes, "FIRST_QUOTA", 50)
    monkeypatch.setattr(problem, "CALL_SECONDS", 1e-4)
    cases, options = grid(OSCILLATOR), mi.Options(method="auto")
    calls = []

    def watch(done):
        calls.append(done)
        if len(calls) == 20:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        map_attractors(cases, BRIEF, options, watch)
    assert 0.0 <= max(calls) < POINTS
    whole = map_attractors(cases, BRIEF, options)
    monkeypatch.setattr(attractor, "LEAST_LANE_POINTS", 10**9)
    assert [content(each) for each in whole] == [
        content(each) for each in map_attractors(cases, BRIEF, options)
    ]


def test_results_tell_whether_lanes_are_used():
    def tiny(system):
        return mi.operating_map(
            system, x=("A", [0.5]), y=("omega", [0.8]), recurrence=BRIEF, progress=False
        )

    assert tiny(OSCILLATOR).lanes
    assert tiny(BILINEAR).lanes
    assert not mi.basins(AUTONOMOUS, x=("x", [0.5]), y=("v", [0.0]), recurrence=BRIEF).lanes
