"""Impact microactuators, and other systems that switch between smooth modes."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mems_impact.actuator.drive import Drive, Sine
    from mems_impact.actuator.parameters import Actuator, load_actuator
    from mems_impact.cvode.options import Options
    from mems_impact.errors import (
        EngineFallbackWarning,
        EngineUnavailable,
        InvalidFile,
        InvalidParameter,
        MemsImpactError,
        RunError,
        SweepInterrupted,
    )
    from mems_impact.plotting.bifurcation import plot_sweep
    from mems_impact.plotting.timeseries import plot_run
    from mems_impact.studies.run import Run
    from mems_impact.studies.simulate import simulate
    from mems_impact.studies.state import State
    from mems_impact.studies.sweep import kicked, sweep
    from mems_impact.tables import sweep_summary

__all__ = [
    "Actuator",
    "Drive",
    "EngineFallbackWarning",
    "EngineUnavailable",
    "InvalidFile",
    "InvalidParameter",
    "MemsImpactError",
    "Options",
    "Run",
    "RunError",
    "Sine",
    "State",
    "SweepInterrupted",
    "kicked",
    "load_actuator",
    "plot_run",
    "plot_sweep",
    "simulate",
    "sweep",
    "sweep_summary",
]

# Where each name lives. Names are imported when they are first used (PEP 562): pandas, numba and
# matplotlib take over a second, which `mems-impact --help` need not wait for.
_HOMES = {
    "actuator.drive": ("Drive", "Sine"),
    "actuator.parameters": ("Actuator", "load_actuator"),
    "cvode.options": ("Options",),
    "errors": (
        "EngineFallbackWarning",
        "EngineUnavailable",
        "InvalidFile",
        "InvalidParameter",
        "MemsImpactError",
        "RunError",
        "SweepInterrupted",
    ),
    "plotting.bifurcation": ("plot_sweep",),
    "plotting.timeseries": ("plot_run",),
    "studies.run": ("Run",),
    "studies.simulate": ("simulate",),
    "studies.state": ("State",),
    "studies.sweep": ("kicked", "sweep"),
    "tables": ("sweep_summary",),
}


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names:
            value = globals()[name] = getattr(import_module(f"{__name__}.{home}"), name)
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
