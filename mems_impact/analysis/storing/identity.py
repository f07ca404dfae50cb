"""What a system is, as JSON: equal for two systems whose numbers are the same."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from typing import Any

from mems_impact.analysis.state import State
from mems_impact.analysis.storing.coding import Writer
from mems_impact.analysis.storing.file import register_rooms
from mems_impact.analysis.system import System
from mems_impact.engines.options import Options

__all__ = ["identity", "identity_of_options", "identity_of_state"]


def identity(system: System) -> dict[str, Any]:
    """Return what tells a system from others: as files tell it, and a digest of its functions."""
    from mems_impact.engines.snapshot import digest  # which imports numba

    register_rooms()
    writer = Writer()
    node = writer.node(system, "system")
    arrays = {
        name: hashlib.sha256(array.tobytes()).hexdigest() for name, array in writer.members.items()
    }
    automaton = system.automaton
    functions = [automaton.flow, automaton.margins, automaton.transition]
    functions += [each.function for each in system.studied]
    return {"system": node, "arrays": arrays, "functions": digest(*functions)}


def identity_of_state(state: State | None) -> dict[str, Any] | None:
    """Return what tells a state from others; None for a system's own start."""
    if state is None:
        return None
    return {**state.as_dict(), "time": state.time, "mode": state.mode}


def identity_of_options(options: Options) -> dict[str, Any]:
    """Return what tells options from others."""
    return asdict(options)
