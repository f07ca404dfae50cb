"""Machine code on disk: the code of an installation, and the cache.

The installation has the event loop and the methods, which depend on no automaton;
`mems_impact.hybrid.precompilation` writes them. The cache has all other code. The name of a file
contains a digest of everything that determines the code, so that code of other functions, of other
versions of numba or llvmlite, or for other processors is never found. A file begins with a digest
of its name and content, so that a damaged or renamed file is not read.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding as llvm
from numba import config
from numba.core.registry import cpu_target

from mems_impact._util.files import replacing
from mems_impact.integrators.jit.cache_directory import cache_directory

DIRECTORY = Path(__file__).with_name("precompiled")
CACHE_SIZE = 256e6  # bytes, some 7,000 functions
SUFFIX, DIGEST = ".code", hashlib.sha256
_log = logging.getLogger("mems_impact")

# --- Files


def read(file: Path) -> Any:
    """Return the content of a file; None if there is none, or if it is damaged."""
    try:
        data = file.read_bytes()
    except OSError:
        return None
    size = DIGEST().digest_size
    if data[:size] != _digest(file, data[size:]):
        _log.info("compiled code in %s cannot be read: its digest differs", file)
        return None
    return pickle.loads(data[size:])


def write(file: Path, content: Any) -> None:
    """Write a file; raise InvalidFile or FileNotWritten."""
    data = pickle.dumps(content, pickle.HIGHEST_PROTOCOL)
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file) as temporary:
        temporary.write_bytes(_digest(file, data) + data)


def _digest(file: Path, data: bytes) -> bytes:
    return DIGEST(file.name.encode() + b"\0" + data).digest()


def _name(function: Callable[..., Any], name: str, signature: Any, *processor: Any) -> str:
    parts = (
        f"{function.__module__}.{function.__qualname__}",
        name,
        str(signature),
        numba.__version__,
        llvmlite.__version__,
        sys.implementation.cache_tag,
        llvm.get_process_triple(),
        config.USING_SVML,  # whether the code may call Intel's vector library
        *processor,
    )
    return f"{DIGEST(repr(parts).encode()).hexdigest()[:40]}{SUFFIX}"


# --- The cache


def cache_file(function: Callable[..., Any], name: str, signature: Any) -> Path | None:
    """Return the file of a function in the cache, or None if there is no cache."""
    directory = cache_directory()
    if directory is None:
        return None
    processor = cpu_target.target_context.codegen().magic_tuple()
    label = re.sub(r"\W", "_", function.__qualname__)[:24]
    return directory / f"{label}-{_name(function, name, signature, processor)}"


def touch(file: Path) -> None:
    """Note that a file is used; the cache keeps the files used last."""
    with suppress(OSError):  # removed by another process, or in a folder that is only read
        os.utime(file)


def prune(directory: Path, size: float = CACHE_SIZE) -> None:
    """Remove the files that were not used for the longest time, until the others fit a size.

    Other processes may read, write and remove files in the meantime: an open file is read to its
    end, and the code of a missing file is compiled again.
    """
    files = sorted(_files(directory), reverse=True)
    total = 0
    for _, length, file in files:
        total += length
        if total > size:
            try:
                file.unlink(missing_ok=True)
            except OSError as error:  # another process has it open, on Windows
                _log.info("%s cannot be removed (%s)", file, error)


def _files(directory: Path) -> Iterator[tuple[float, int, Path]]:
    """Yield time of use, size and path of each file."""
    for entry in os.scandir(directory):
        try:
            status = entry.stat()
        except FileNotFoundError:  # removed by another process
            continue
        if entry.is_file():
            yield status.st_mtime, status.st_size, Path(entry.path)


# --- The installation

# Instruction sets by the names of LLVM, the best one first, with the features that they require.
X86_64_V3 = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sse4.2", "xsave")
X86_INSTRUCTION_SETS = {"x86-64-v3": X86_64_V3, "x86-64": ()}


@cache
def instruction_sets() -> tuple[str, ...]:
    """Return the instruction sets of this processor for which code is shipped, the best first."""
    if not llvm.get_process_triple().startswith("x86_64"):
        return ("generic",)
    features = llvm.get_host_cpu_features()
    return tuple(
        name
        for name, required in X86_INSTRUCTION_SETS.items()
        if all(features.get(feature) for feature in required)
    )


def is_installed() -> bool:
    """Return whether the installation contains machine code."""
    return any(DIRECTORY.glob(f"*{SUFFIX}"))


def shipped_files(function: Callable[..., Any], name: str, signature: Any) -> list[Path]:
    """Return the files in which the installation may have a function, the best first."""
    if config.CPU_NAME is not None or config.CPU_FEATURES is not None:
        return []  # the environment prescribes a processor
    return [DIRECTORY / _name(function, name, signature, each) for each in instruction_sets()]


_recording = False


def record() -> None:
    """Let this process write all code that it compiles, for the instruction set NUMBA_CPU_NAME."""
    global _recording
    _recording = True


def is_recording() -> bool:
    """Return whether `record` was called."""
    return _recording


def recorded_file(function: Callable[..., Any], name: str, signature: Any) -> Path:
    """Return the file of the installation to which a function is written."""
    return DIRECTORY / _name(function, name, signature, config.CPU_NAME)
