"""The bindings: refused where they do not fit, freed, safe from threads, interruptible."""

import gc
import os
import signal
import subprocess
import sys
import textwrap
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from mems_impact.errors import EngineFallbackWarning, EngineUnavailable
from mems_impact.integrators.cvode import compiled, interpreted
from mems_impact.integrators.cvode import compiled as library
from mems_impact.integrators.interface import Equations
from mems_impact.integrators.options import Options
from tests.hybrid.systems import (
    BALL,
    COULOMB,
    STOP,
    TAU,
    ball,
    coulomb,
    same,
    simulate,
    stop,
)

GOOD = {
    "SUNDIALS_VERSION": "7.9.0",
    "SUNDIALS_FLOAT_TYPE": "double",
    "SUNDIALS_INT_TYPE": "int",
}
REAL, INDEX = "SUNDIALS_FLOAT_TYPE", "SUNDIALS_INT_TYPE"


def test_this_installation_is_supported():
    library.check(GOOD)
    assert library.load() is library.load()
    from sksundae import _cy_common

    library.check(_cy_common.config)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("SUNDIALS_VERSION", "6.7.0"),
        ("SUNDIALS_VERSION", "8.0.0"),
        ("SUNDIALS_VERSION", "70.1"),
        ("SUNDIALS_VERSION", ""),
        (REAL, "float"),
        (REAL, "long double"),
        (INDEX, "long int"),
        (INDEX, None),
    ],
)
def test_another_build_is_refused(key, value):
    with pytest.raises(EngineUnavailable) as caught:
        library.check({**GOOD, key: value})
    assert repr(value) in str(caught.value)
    assert key in str(caught.value)
    assert "engine 'interpreted'" in caught.value.remedy


def test_an_empty_configuration_is_refused():
    with pytest.raises(EngineUnavailable):
        library.check({})


@pytest.fixture
def unavailable(monkeypatch):
    def load():
        raise EngineUnavailable("SUNDIALS is of version 9", library.LIBRARY_REMEDY)

    monkeypatch.setattr(library, "load", load)


@pytest.mark.usefixtures("unavailable")
@pytest.mark.parametrize(
    ("method", "replacement"),
    [("adams", {"method": "dop853"}), ("bdf", {"method": "bdf", "engine": "interpreted"})],
)
def test_another_method_or_engine_replaces_it_with_one_warning(method, replacement):
    with pytest.warns(EngineFallbackWarning, match="version 9") as caught:
        run = simulate(BALL, ball(0.5), [1.0, 0.0], 0.5, engine="auto", method=method)
    assert len(caught) == 1
    assert {name: getattr(run.problem.options, name) for name in replacement} == replacement
    direct = simulate(BALL, ball(0.5), [1.0, 0.0], 0.5, **replacement)
    assert same(run.events, direct.events)


@pytest.mark.usefixtures("unavailable")
def test_compiled_on_demand_raises():
    with pytest.raises(EngineUnavailable, match="version 9"):
        simulate(BALL, ball(0.5), [1.0, 0.0], 0.5, engine="compiled")


def test_what_is_missing_is_looked_for_once(monkeypatch):
    looked = []
    monkeypatch.setattr(library, "_library_files", lambda: looked.append(1) or ["nowhere.so"])
    library._opened.cache_clear()
    try:
        for _ in range(2):
            with pytest.raises(EngineUnavailable, match="nowhere"):
                library.load()
    finally:
        library._opened.cache_clear()
    assert looked == [1]


def test_auto_takes_the_compiled_engine():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        auto = simulate(BALL, ball(0.5), [1.0, 0.0], 0.5, engine="auto")
    assert same(auto.events, simulate(BALL, ball(0.5), [1.0, 0.0], 0.5).events)


@pytest.mark.parametrize("method", ["adams", "bdf"])
@pytest.mark.parametrize("kind", [compiled, interpreted])
def test_an_engine_steps_on_its_own(kind, method):
    """The contract of `integrators.interface`, without the loop."""
    engine = make(kind, method)
    swing = np.array([1.0, 0.0])
    if kind is interpreted:
        engine.restart(0, 0.0, swing, np.inf)
        assert engine.step() == 0
        assert engine.time() > 0.0
        y = np.zeros(2)
        engine.state(y)
        assert y == pytest.approx([np.cos(engine.time()), -np.sin(engine.time())], abs=1e-6)
    engine.close()
    engine.close()


def make(kind=compiled, method="adams"):
    equations = Equations(
        flow=STOP.flow,
        margins=STOP.margins,
        transition=STOP.transition,
        n=2,
        m=2,
        parameters=stop(d=9.0),
        approaches=[True, True],
    )
    engine = kind.CompiledCvode if kind is compiled else kind.InterpretedCvode
    return engine(equations, Options(method=method), 0.1)


def resident():
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc")
@pytest.mark.parametrize("method", ["adams", "bdf"])
def test_engines_free_their_memory(method):
    def burn(number):
        for _ in range(number):
            make(method=method)
        gc.collect()

    burn(1000)
    before = resident()
    burn(4000)
    assert resident() - before < 500_000  # 125 bytes an engine


@pytest.mark.slow
def test_threads_give_what_one_thread_gives():
    def one(k):
        e = 0.3 + 0.005 * k
        runs = (
            simulate(BALL, ball(e, 0.9, 1.0), [1.0, 0.0], 40.0),
            simulate(STOP, stop(0.1, 1.0, 0.7, 0.8, e=e), [0.2, 1.0], 40.0, period=TAU / 0.8),
            simulate(COULOMB, coulomb(e, 1.0, 0.4), [0.5, 0.0], 40.0, period=TAU / 0.4),
        )
        return [(run.events, run.samples(10).y) for run in runs]

    serial = [one(k) for k in range(8)]
    with ThreadPoolExecutor(8) as pool:
        parallel = list(pool.map(one, range(8)))
    for a, b in zip(serial, parallel, strict=True):
        for (events, samples), (other_events, other_samples) in zip(a, b, strict=True):
            assert same(events, other_events)
            assert np.array_equal(samples, other_samples)


@pytest.mark.slow
def test_interpreted_engines_in_threads_leave_standard_output_alone():
    out = sys.stdout

    def one(_):
        return simulate(BALL, ball(0.5), [1.0, 0.0], 0.7, engine="interpreted").events

    with ThreadPoolExecutor(8) as pool:
        logs = list(pool.map(one, range(16)))
    assert sys.stdout is out
    assert all(same(log, logs[0]) for log in logs)


# A shell that starts something in the background lets it ignore interrupts, and so do its children.
ENDLESS = """
    import signal, sys
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.path.insert(0, {root!r})
    from tests.hybrid.systems import STOP, TAU, simulate, stop
    p = stop(0.1, 1.0, 0.7, 0.8)
    simulate(STOP, p, [0.2, 1.5], 5.0, period=TAU / 0.8, engine={engine!r})
    print("running", flush=True)
    simulate(STOP, p, [0.2, 1.5], 1e8, period=TAU / 0.8, engine={engine!r})
"""


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["compiled", "interpreted"])
def test_an_interrupt_ends_a_long_run_and_keeps_it(engine):
    code = textwrap.dedent(ENDLESS).format(root=str(Path(__file__).parents[2]), engine=engine)
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout.readline() == "running\n"
            time.sleep(0.5)
            assert process.poll() is None
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=60)
        finally:
            process.kill()
        assert "Interrupted: run interrupted after" in errors


# Libraries of SUNDIALS in the wheels of scikit-sundae, by platform: Linux and macOS find them
# through the extension module, on Windows this package opens them by these names.
LIBRARIES = {
    "manylinux_2_28_x86_64": "scikit_sundae.libs/libsundials*",
    "macosx_11_0_arm64": "sksundae/.dylibs/libsundials*",
    "macosx_11_0_x86_64": "sksundae/.dylibs/libsundials*",
    "win_amd64": "scikit_sundae.libs/*sundials*.dll",
}


EXPORTS = """
import lief, sys
for file in sys.argv[1:]:
    for function in lief.parse(file).exported_functions:
        print(function.name.removeprefix("_"))
"""


@pytest.mark.slow(all=True)
@pytest.mark.parametrize("platform", LIBRARIES)
def test_wheels_of_other_platforms_export_every_function(platform, tmp_path):
    if find_spec("lief") is None:
        pytest.skip("needs lief")
    command = ["download", "-q", "--no-deps", "--only-binary=:all:", "--platform", platform]
    requirement = f"scikit-sundae=={version('scikit-sundae')}"
    done = subprocess.run(
        [sys.executable, "-m", "pip", *command, "--dest", str(tmp_path), requirement],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        pytest.skip(f"no package index, or no wheel: {done.stderr.splitlines()[-1]}")
    (wheel,) = tmp_path.glob("*.whl")
    with ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    files = sorted(tmp_path.glob(LIBRARIES[platform]))
    # In a process of its own, since lief reports leaks at the end.
    listed = subprocess.run(
        [sys.executable, "-c", EXPORTS, *files], capture_output=True, text=True, check=True
    )
    assert set(library.SIGNATURES) - set(listed.stdout.split()) == set()
