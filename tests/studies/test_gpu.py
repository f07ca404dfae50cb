"""Maps on a GPU, without one: on numba's simulator, and translated for a device."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import pytest
from numba import cuda, types

import mems_impact as mi
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.attractor import STUDY_OPTIONS
from mems_impact.hybrid.attractors.cuda import GpuMapper
from mems_impact.hybrid.attractors.mapper import AttractorMapper
from mems_impact.integrators.jit import numba_support

ACTUATOR, DRIVE = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)


def mapped(**options):
    return mi.operating_map(ACTUATOR, DRIVE, x=("amplitude", [0.2]), y=("omega", [0.5]), **options)


@pytest.mark.skipif(cuda.is_available(), reason="there is a GPU")
def test_without_a_gpu_the_error_has_the_remedy():
    with pytest.raises(mi.EngineUnavailable, match=r"no NVIDIA GPU .*\[cuda\]"):
        mapped(executor="cuda")


@pytest.mark.skipif(cuda.is_available(), reason="there is a GPU")
def test_the_error_of_a_launch_has_the_remedy(monkeypatch):
    monkeypatch.setattr(numba_support, "check_cuda", lambda: None)
    with pytest.raises(mi.EngineUnavailable, match=r"the GPU cannot run .*; leave executor out"):
        mapped(executor="cuda")


def test_a_gpu_integrates_by_dop853_alone():
    with pytest.raises(mi.InvalidParameter, match="'auto' or 'dop853'"):
        mapped(executor="cuda", options=mi.Options(method="bdf"))


def test_an_unknown_executor():
    with pytest.raises(mi.InvalidParameter, match="'cuda'"):
        mapped(executor="gpu")


def test_points_that_depend_on_each_other_are_refused():
    with pytest.raises(mi.InvalidParameter, match="sweep computes no points on a GPU"):
        mi.sweep(ACTUATOR, DRIVE, "amplitude", [0.2, 0.21], executor="cuda")


def test_a_store_of_a_processor_is_not_resumed_by_a_gpu(monkeypatch, tmp_path):
    monkeypatch.setattr(numba_support, "check_cuda", lambda: None)
    place, options = tmp_path / "map", mi.Options(engine="interpreted", method="dop853")
    brief = mi.RecurrenceOptions(transient=1, periods=1, exponents="none")
    mapped(store=place, recurrence=brief, options=options)
    with pytest.raises(mi.MemsImpactError, match=r"executor is .* there, 'cuda' here"):
        mapped(store=place, recurrence=brief, options=options, executor="cuda")


SIMULATED = """
import json, math
import numpy as np
import mems_impact as mi
from mems_impact.hybrid.attractors.cuda import GpuMapper

finished = []
follow = GpuMapper.follow

def watched(self, inputs, results, *lengths):
    follow(self, inputs, results, *lengths)
    finished.append(np.isfinite(results[:, 0]).tolist())

GpuMapper.follow = watched

def flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - y.x - p.c * y.v

def gap(mode, t, y, p):
    return p.d - y.x

def rebound(mode, t, y, p):
    return mode, (p.d, -0.8 * y.v)

system = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"c": 0.1, "d": 1.0, "A": 0.6, "omega": 0.8},
    guards=[mi.Impact("stop", gap, rebound)],
)
actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
cases = [
    ((system,), ("A", [0.1, 0.6]), ("c", [1.0, 1e308])),  # the second c overflows
    ((actuator, drive), ("amplitude", [0.24]), ("omega", [0.49, 0.5])),
]
equal = []
for owner, x, y in cases:
    tables = [
        mi.operating_map(
            *owner, x=x, y=y, executor=executor,
            recurrence=mi.RecurrenceOptions(transient=12, periods=4, exponents="none"),
            options=mi.Options(engine="interpreted", method="dop853", rtol=1e-6),
        ).table
        for executor in (None, "cuda")
    ]
    equal.append(tables[0].equals(tables[1]))
print(json.dumps([finished, equal]))
"""


@pytest.mark.slow
def test_the_simulator_and_python_compute_the_same_bits():
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}
    command = [sys.executable, "-W", "ignore", "-c", SIMULATED]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    finished, equal = json.loads(done.stdout)
    # Preparation maps one point; Python computes the points that fail.
    assert finished == [[True], [True, True, False, False], [True], [True, True]]
    assert equal == [True, True]


@pytest.mark.slow
def test_the_kernel_is_translated_for_a_device(monkeypatch):
    if getattr(cuda, "implementation", "") != "NVIDIA":
        pytest.skip("numba-cuda is not installed")
    from numba.cuda import dispatcher

    device = SimpleNamespace(compute_capability=(9, 0))
    monkeypatch.setattr(dispatcher, "get_current_device", lambda: device)
    system = ActuatorSystem(ACTUATOR, DRIVE)
    problem = system.problem(STUDY_OPTIONS)
    plain = replace(problem.options, engine="interpreted", method="dop853")
    mapper = AttractorMapper(
        replace(problem, options=plain), longest=16, tolerance=1e-6, observed=system.observed
    )
    kernel, records = GpuMapper(mapper).kernel(20, 200, 300.0, 100.0)
    words, rows = types.float64[::1], types.float64[:, ::1]
    ptx, _ = cuda.compile_ptx(
        kernel.py_func, (words, words, words, rows, rows, types.int64), cc=(9, 0)
    )
    # Each thread holds the records in its local memory, and no function is missing.
    (memory,) = re.findall(r"__local_depot0\[(\d+)\]", ptx)
    assert int(memory) >= 8 * sum(map(len, records))
    assert ptx.count(".entry") == 1
    assert ".extern .func" not in ptx
    # Fields are read as words, and threads wait for each other at one place.
    assert "ld.u8" not in ptx
    assert ptx.count("bar.warp.sync") == 1
