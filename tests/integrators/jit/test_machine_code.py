"""Machine code of an installation and of the cache: loaded where it fits, and nowhere else."""

import io
import logging
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from numba import types

from mems_impact.hybrid import precompilation
from mems_impact.hybrid.simulation import run
from mems_impact.integrators.auto import compiled as auto
from mems_impact.integrators.cvode import compiled as cvode
from mems_impact.integrators.dop853 import compiled as dop853
from mems_impact.integrators.jit import kernels, machine_code, numba_support

ROOT = Path(__file__).parents[3]
SIGNATURE = types.float64(types.float64)


def half(x):
    return 0.5 * x


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty installation, and no prescription of a processor."""
    monkeypatch.setattr(machine_code, "DIRECTORY", tmp_path / "precompiled")
    monkeypatch.setattr(machine_code.config, "CPU_NAME", None)
    monkeypatch.setattr(machine_code.config, "CPU_FEATURES", None)
    return tmp_path / "precompiled"


def write(instruction_set, content="code"):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(machine_code.config, "CPU_NAME", instruction_set)
        file = machine_code.recorded_file(half, "of a test", SIGNATURE)
        machine_code.write(file, content)


def read():
    files = machine_code.shipped_files(half, "of a test", SIGNATURE)
    return next(filter(None, map(machine_code.read, files)), None)


@pytest.mark.usefixtures("place")
def test_the_best_instruction_set_of_the_processor_is_read(monkeypatch):
    monkeypatch.setattr(machine_code, "instruction_sets", lambda: ("best", "baseline"))
    assert read() is None
    assert not machine_code.is_installed()
    write("beyond")
    assert read() is None
    write("baseline", "slow")
    assert read() == "slow"
    write("best", "fast")
    assert read() == "fast"
    assert machine_code.is_installed()


def test_a_processor_without_fused_multiply_add_takes_the_baseline(monkeypatch):
    features = dict.fromkeys((*machine_code.X86_64_V3, "sse2"), True)
    monkeypatch.setattr(machine_code.llvm, "get_process_triple", lambda: "x86_64-unknown-linux-gnu")
    monkeypatch.setattr(machine_code.llvm, "get_host_cpu_features", lambda: features)
    sets = machine_code.instruction_sets.__wrapped__
    assert sets() == ("x86-64-v3", "x86-64")
    features["fma"] = False
    assert sets() == ("x86-64",)


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize(
    ("owner", "name", "other"),
    [
        (machine_code.numba, "__version__", "0.1"),
        (machine_code.llvmlite, "__version__", "0.1"),
        (machine_code.sys.implementation, "cache_tag", "cpython-3"),
        (machine_code.llvm, "get_process_triple", lambda: "aarch64-apple-darwin"),
        (machine_code.config, "USING_SVML", not machine_code.config.USING_SVML),
        (machine_code.config, "CPU_NAME", "generic"),
        (machine_code.config, "CPU_FEATURES", "-avx"),
    ],
)
def test_code_of_another_installation_is_not_read(monkeypatch, owner, name, other):
    monkeypatch.setattr(machine_code, "instruction_sets", lambda: ("baseline",))
    write("baseline")
    assert read() == "code"
    monkeypatch.setattr(owner, name, other)
    assert read() is None


def test_a_damaged_file_is_compiled_again(place, caplog):
    write(machine_code.instruction_sets()[0])
    (file,) = place.iterdir()
    file.write_bytes(file.read_bytes()[:5])
    with caplog.at_level(logging.INFO, "mems_impact"):
        done = numba_support.compile_callback(half, SIGNATURE, "of a test")
    assert done.ctypes(3.0) == 1.5
    assert "cannot be read" in caplog.text


def damaged(data, generator):
    """Data with a bit flipped, cut off, or with a block exchanged."""
    kind, place = generator.integers(3), int(generator.integers(len(data)))
    if kind == 0:
        flipped = data[place] ^ (1 << int(generator.integers(8)))
        return data[:place] + bytes([flipped]) + data[place + 1 :]
    return data[:place] if kind == 1 else data[place:] + data[:place] + b"\0"


def test_a_file_with_a_changed_bit_or_of_another_function_is_not_read(tmp_path):
    generator = np.random.default_rng(1)
    one, other = tmp_path / "one.code", tmp_path / "other.code"
    machine_code.write(one, ("code", bytes(1000)))
    machine_code.write(other, ("code", bytes(1000)))
    data = one.read_bytes()
    for _ in range(300):
        one.write_bytes(damaged(data, generator))
        assert machine_code.read(one) is None
    other.replace(one)
    assert machine_code.read(one) is None
    one.write_bytes(data)
    assert machine_code.read(one) == ("code", bytes(1000))


def test_the_cache_keeps_the_files_used_last(tmp_path):
    files = [tmp_path / f"{i}.code" for i in range(10)]
    for i, file in enumerate(files):
        file.write_bytes(bytes(100))
        os.utime(file, (1000.0 + i, 1000.0 + i))
    machine_code.touch(files[0])
    machine_code.prune(tmp_path, 450.0)
    assert sorted(tmp_path.iterdir()) == sorted([files[0], *files[7:]])
    machine_code.prune(tmp_path, 450.0)
    assert len(list(tmp_path.iterdir())) == 4


def test_processes_may_remove_files_at_the_same_time(tmp_path, monkeypatch):
    for i in range(50):
        (tmp_path / f"{i}.code").write_bytes(bytes(100))
    unlink = Path.unlink

    def twice(self, **options):
        unlink(self, missing_ok=True)
        unlink(self, **options)

    monkeypatch.setattr(Path, "unlink", twice)
    machine_code.prune(tmp_path, 1000.0)
    assert len(list(tmp_path.iterdir())) == 10


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
    from mems_impact.integrators.jit import machine_code
    machine_code.DIRECTORY = Path(sys.argv[1])
    from mems_impact.hybrid import precompilation
    from mems_impact.hybrid.simulation import run
    logging.basicConfig(level=logging.INFO)
    if "record" in sys.argv:
        machine_code.record()
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

    (name, *_) = machine_code.instruction_sets()
    go(tmp_path / "code", "record", NUMBA_CPU_NAME=name, NUMBA_CPU_FEATURES="")
    first = go(tmp_path / "code")
    assert numba_support.LOOP_NOTICE not in first.stderr
    assert numba_support.SYSTEM_NOTICE in first.stderr
    here = run(precompilation.decay("dop853"), precompilation.START, 1.0)
    assert first.stdout == f"{here.final.y[0]!r}\n"
