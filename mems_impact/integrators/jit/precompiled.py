"""Machine code of an installation: the event loop and the methods, which depend on no automaton.

`mems_impact.hybrid.precompilation` writes it when the package is installed. The name of a file is a
digest of everything that determines the code, so that code of other sources, of other versions of
numba or llvmlite, or for other processors is never found.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding as llvm
from numba import config

from mems_impact._util.files import replacing

DIRECTORY = Path(__file__).with_name("precompiled")

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


def exists() -> bool:
    """Return whether the installation contains machine code."""
    return any(DIRECTORY.glob("*.code"))


def read(function: Callable[..., Any], name: str, signature: Any) -> Any:
    """Return the content written for a function; None if nothing fits this installation."""
    if config.CPU_NAME is not None or config.CPU_FEATURES is not None:
        return None  # the environment prescribes a processor
    for instruction_set in instruction_sets():
        try:
            return pickle.loads(_file(function, name, signature, instruction_set).read_bytes())
        except FileNotFoundError:
            continue
    return None


_recording = False


def record() -> None:
    """Let this process write all code that it compiles, for the instruction set NUMBA_CPU_NAME."""
    global _recording
    _recording = True


def is_recording() -> bool:
    """Return whether `record` was called."""
    return _recording


def write(function: Callable[..., Any], name: str, signature: Any, content: Any) -> None:
    """Write the content for a function."""
    DIRECTORY.mkdir(exist_ok=True)
    with replacing(_file(function, name, signature, config.CPU_NAME)) as file:
        file.write_bytes(pickle.dumps(content, pickle.HIGHEST_PROTOCOL))


def _file(function: Callable[..., Any], name: str, signature: Any, instruction_set: str) -> Path:
    parts = (
        f"{function.__module__}.{function.__qualname__}",
        name,
        str(signature),
        numba.__version__,
        llvmlite.__version__,
        sys.implementation.cache_tag,
        llvm.get_process_triple(),
        instruction_set,
        config.USING_SVML,  # whether the code may call Intel's vector library
    )
    return DIRECTORY / f"{hashlib.sha256(repr(parts).encode()).hexdigest()[:40]}.code"
