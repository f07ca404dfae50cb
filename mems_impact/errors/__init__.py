"""The exceptions of the package: one small tree, whose messages carry values and the remedy.

Every exception survives pickling with all its attributes, because sweeps report failures from
other processes. Every message is one line, because the command line prints it as it stands.
"""

from __future__ import annotations

from mems_impact.errors.base import MemsImpactError, Picklable
from mems_impact.errors.given import (
    FileNotWritten,
    FunctionError,
    FunctionsMissing,
    InvalidFile,
    InvalidParameter,
)
from mems_impact.errors.running import EngineUnavailable, OrbitError, RunError, WorkersLost

__all__ = [
    "EngineUnavailable",
    "FileNotWritten",
    "FunctionError",
    "FunctionsMissing",
    "InvalidFile",
    "InvalidParameter",
    "MemsImpactError",
    "OrbitError",
    "Picklable",
    "RunError",
    "WorkersLost",
]
