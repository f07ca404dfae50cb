"""Machine code of an installation: loaded where it fits exactly, and nowhere else."""

import io
import logging
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from numba import types

from mems_impact.hybrid import precompilation
from mems_impact.hybrid.simulation import run
from mems_impact.integrators.auto import compiled as auto
from mems_impact.integrators.cvode import compiled as cvode
from mems_impact.integrators.dop853 import compiled as dop853
from mems_impact.integrators.jit import kernels, numba_support, precompiled

ROOT = Path(__file__).parents[3]
SIGNATURE = types.float64(types.float64)


def half(x):
    return 0.5 * x


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty installation, and no prescription of a processor."""
    monkeypatch.setattr(precompiled, "DIRECTORY", tmp_path / "precompiled")
    monkeypatch.setattr(precompiled.config, "CPU_NAME", None)
    monkeypatch.setattr(precompiled.config, "CPU_FEATURES", None)
    return tmp_path / "precompiled"


def write(instruction_set, content="code"):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(precompiled.config, "CPU_NAME", instruction_set)
        precompiled.write(half, "of a test", SIGNATURE, content)


def read():
    return precompiled.read(half, "of a test", SIGNATURE)


@pytest.mark.usefixtures("place")
def test_the_best_instruction_set_of_the_processor_is_read(monkeypatch):
    monkeypatch.setattr(precompiled, "instruction_sets", lambda: ("best", "baseline"))
    assert read() is None
    assert not precompiled.exists()
    write("beyond")
    assert read() is None
    write("baseline", "slow")
    assert read() == "slow"
    write("best", "fast")
    assert read() == "fast"
    assert precompiled.exists()


def test_a_processor_without_fused_multiply_add_takes_the_baseline(monkeypatch):
    features = dict.fromkeys((*precompiled.X86_64_V3, "sse2"), True)
    monkeypatch.setattr(precompiled.llvm, "get_process_triple", lambda: "x86_64-unknown-linux-gnu")
    monkeypatch.setattr(precompiled.llvm, "get_host_cpu_features", lambda: features)
    sets = precompiled.instruction_sets.__wrapped__
    assert sets() == ("x86-64-v3", "x86-64")
    features["fma"] = False
    assert sets() == ("x86-64",)


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize(
    ("owner", "name", "other"),
    [
        (precompiled.numba, "__version__", "0.1"),
        (precompiled.llvmlite, "__version__", "0.1"),
        (precompiled.sys.implementation, "cache_tag", "cpython-3"),
        (precompiled.llvm, "get_process_triple", lambda: "aarch64-apple-darwin"),
        (precompiled.config, "USING_SVML", not precompiled.config.USING_SVML),
        (precompiled.config, "CPU_NAME", "generic"),
        (precompiled.config, "CPU_FEATURES", "-avx"),
    ],
)
def test_code_of_another_installation_is_not_read(monkeypatch, owner, name, other):
    monkeypatch.setattr(precompiled, "instruction_sets", lambda: ("baseline",))
    write("baseline")
    assert read() == "code"
    monkeypatch.setattr(owner, name, other)
    assert read() is None


def test_a_damaged_file_is_compiled_again(place, caplog):
    write(precompiled.instruction_sets()[0])
    (file,) = place.iterdir()
    file.write_bytes(file.read_bytes()[:5])
    with caplog.at_level(logging.INFO, "mems_impact"):
        done = numba_support.compile_callback(half, SIGNATURE, "of a test")
    assert done.ctypes(3.0) == 1.5
    assert "cannot be read" in caplog.text


@pytest.mark.usefixtures("place")
def test_code_that_does_not_fit_is_announced(monkeypatch, caplog):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    announce = numba_support.announce.__wrapped__
    with caplog.at_level(logging.INFO, "mems_impact"):
        announce(numba_support.LOOP_NOTICE)
        assert "the code compiled at installation" not in caplog.text
        write("beyond")
        announce(numba_support.LOOP_NOTICE)
    assert "the code compiled at installation is for other sources" in caplog.text


@pytest.mark.parametrize("module", [cvode, dop853, auto])
def test_the_loop_finds_its_fields_in_every_handle(module):
    for name, (kind, offset) in kernels.ENGINE.fields.items():
        assert module.HANDLE.fields[name][:2] == (kind, offset)


RUN = """
    import logging, sys
    from pathlib import Path
    from mems_impact.integrators.jit import precompiled
    precompiled.DIRECTORY = Path(sys.argv[1])
    from mems_impact.hybrid import precompilation
    from mems_impact.hybrid.simulation import run
    logging.basicConfig(level=logging.INFO)
    if "record" in sys.argv:
        precompiled.record()
    print(repr(run(precompilation.decay("dop853"), precompilation.START, 1.0).final.y[0]))
"""


@pytest.mark.slow
def test_a_first_run_compiles_the_automaton_only(tmp_path):
    def go(directory, *words, **environment):
        paths = {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / directory.name)}
        return subprocess.run(
            [sys.executable, "-c", textwrap.dedent(RUN), str(directory), *words],
            env={**os.environ, **paths, **environment},
            capture_output=True,
            text=True,
            check=True,
        )

    first = go(precompiled.DIRECTORY)
    if numba_support.LOOP_NOTICE in first.stderr:  # not installed so, or edited since
        (name, *_) = precompiled.instruction_sets()
        go(tmp_path / "code", "record", NUMBA_CPU_NAME=name, NUMBA_CPU_FEATURES="")
        first = go(tmp_path / "code")
    assert numba_support.LOOP_NOTICE not in first.stderr
    assert numba_support.SYSTEM_NOTICE in first.stderr
    here = run(precompilation.decay("dop853"), precompilation.START, 1.0)
    assert first.stdout == f"{here.final.y[0]!r}\n"
