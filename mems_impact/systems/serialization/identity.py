"""Identity of systems, states and options, by which stores of studies recognize their own."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from typing import Any

from mems_impact.integrators.options import Options
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.serialization.archive import register_storables
from mems_impact.systems.serialization.codec import Writer
from mems_impact.systems.state import State


def identity(system: HybridSystem, options: Options) -> dict[str, Any]:
    """Return the identity of a system and of the options by which it is integrated.

    The system has a description, and a digest of its functions.
    """
    from mems_impact.integrators.jit.closures import digest  # which imports numba

    register_storables()
    writer = Writer()
    node = writer.node(system, "system")
    arrays = {
        name: hashlib.sha256(array.tobytes()).hexdigest() for name, array in writer.members.items()
    }
    automaton = system.automaton
    functions = [automaton.flow, automaton.margins, automaton.transition]
    functions += [each.function for each in system.statistics.observables]
    functions += system.checks.times
    return {
        "system": node,
        "arrays": arrays,
        "functions": digest(*functions),
        "options": asdict(system.problem(options).options),
    }


def identity_of_state(state: State | None) -> dict[str, Any] | None:
    """Return the identity of a state; None for the initial state of the system."""
    if state is None:
        return None
    return {**state.as_dict(), "time": state.time, "mode": state.mode}
