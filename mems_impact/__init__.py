"""Impact microactuators, and other systems that switch between smooth modes."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from mems_impact.actuator.drives import WAVEFORMS
from mems_impact.actuator.terms import TERMS

if TYPE_CHECKING:
    from mems_impact.actuator.design.blows import Blows, blows
    from mems_impact.actuator.design.chart import Chart
    from mems_impact.actuator.design.charting import operating_chart
    from mems_impact.actuator.design.duty import Duty, duty_cycle
    from mems_impact.actuator.design.energy import Energy, energy
    from mems_impact.actuator.design.estimates import (
        pull_in_voltage,
        resting_voltage,
        step_length,
        step_lengths,
    )
    from mems_impact.actuator.design.fit import Fit, fit
    from mems_impact.actuator.design.life import Life, life
    from mems_impact.actuator.design.load import LoadCurve, load_curve
    from mems_impact.actuator.design.response import frequency_response, impact_onset
    from mems_impact.actuator.design.ring_down import RingDown, ring_down
    from mems_impact.actuator.design.speeds import resolution, speed_over_voltage
    from mems_impact.actuator.design.targets import Target
    from mems_impact.actuator.design.window import Window, period_one_window
    from mems_impact.actuator.drives import *  # noqa: F403
    from mems_impact.actuator.drives import Drive, load_drive
    from mems_impact.actuator.figures.chart import plot_chart
    from mems_impact.actuator.figures.drive import plot_drive
    from mems_impact.actuator.figures.energy import plot_energy
    from mems_impact.actuator.figures.load import plot_load
    from mems_impact.actuator.figures.response import plot_response
    from mems_impact.actuator.own_system import load_system
    from mems_impact.actuator.parameters import Actuator, load_actuator
    from mems_impact.actuator.study_file import load_study
    from mems_impact.actuator.system import kicked
    from mems_impact.actuator.terms import *  # noqa: F403
    from mems_impact.actuator.terms import Term
    from mems_impact.actuator.verbs import find_orbit, simulate
    from mems_impact.analysis.attractor import Settling
    from mems_impact.analysis.branch import Branch, Steps, continue_orbit, switch_branch
    from mems_impact.analysis.curve import Curve, continue_curve
    from mems_impact.analysis.equilibria import EquilibriumBranch, continue_equilibrium
    from mems_impact.analysis.equilibrium import Equilibrium, EquilibriumPoint, find_equilibria
    from mems_impact.analysis.lyapunov import LyapunovSpectrum, classify, lyapunov
    from mems_impact.analysis.modes import modes
    from mems_impact.analysis.observable import Observable
    from mems_impact.analysis.orbit import Orbit
    from mems_impact.analysis.parts.friction import Friction, Stribeck
    from mems_impact.analysis.parts.part import Part
    from mems_impact.analysis.parts.relay import Relay
    from mems_impact.analysis.parts.stopper import Stopper
    from mems_impact.analysis.parts.surface import Surface
    from mems_impact.analysis.quantity import Quantity
    from mems_impact.analysis.run import Run
    from mems_impact.analysis.special import GrazingType, SpecialPoint, grazing_type
    from mems_impact.analysis.state import State
    from mems_impact.analysis.storing.file import load
    from mems_impact.analysis.system import System
    from mems_impact.analysis.verification import Verification
    from mems_impact.engines.options import Options
    from mems_impact.errors import (
        EngineUnavailable,
        FileNotWritten,
        FunctionError,
        FunctionsMissing,
        InvalidFile,
        InvalidParameter,
        MemsImpactError,
        OrbitError,
        RunError,
        WorkersLost,
    )
    from mems_impact.hybrid.automaton import Guard, Impact
    from mems_impact.interruptions import (
        ChartInterrupted,
        Interrupted,
        OptimizationInterrupted,
        RunInterrupted,
        StudyInterrupted,
        SweepInterrupted,
    )
    from mems_impact.plotting.animation import Animation, animate
    from mems_impact.plotting.basins import plot_basins
    from mems_impact.plotting.branch import plot_branch
    from mems_impact.plotting.curve import plot_curve
    from mems_impact.plotting.map import plot_map
    from mems_impact.plotting.orbit import plot_orbit
    from mems_impact.plotting.pareto import plot_pareto
    from mems_impact.plotting.run import plot_run
    from mems_impact.plotting.scatter import plot_scatter
    from mems_impact.plotting.sensitivity import plot_sensitivity
    from mems_impact.plotting.style import style
    from mems_impact.plotting.sweep import plot_sweep
    from mems_impact.studies.basins import Basins, basins
    from mems_impact.studies.following import AttractorBranches, follow_attractors
    from mems_impact.studies.margins import margins
    from mems_impact.studies.motions import map_summary
    from mems_impact.studies.operating_map import OperatingMap, operating_map
    from mems_impact.studies.optimize import Optimum, optimize
    from mems_impact.studies.pareto import ParetoFront, pareto_front
    from mems_impact.studies.scatter import Scatter, scatter
    from mems_impact.studies.sensitivity import Sensitivity, sensitivity
    from mems_impact.studies.stored_study import StoredStudy, read_study
    from mems_impact.studies.sweep import sweep
    from mems_impact.tables.labelled import to_xarray
    from mems_impact.tables.sweep import sweep_summary
    from mems_impact.warnings import (
        DiscontinuityWarning,
        EngineFallbackWarning,
        FitWarning,
        PluginWarning,
        ScaleWarning,
        StartWarning,
        StiffnessWarning,
        UnitsWarning,
        ValidityWarning,
    )

__all__ = [
    *TERMS.values(),
    *WAVEFORMS.values(),
    "Actuator",
    "Animation",
    "AttractorBranches",
    "Basins",
    "Blows",
    "Branch",
    "Chart",
    "ChartInterrupted",
    "Curve",
    "DiscontinuityWarning",
    "Drive",
    "Duty",
    "Energy",
    "EngineFallbackWarning",
    "EngineUnavailable",
    "Equilibrium",
    "EquilibriumBranch",
    "EquilibriumPoint",
    "FileNotWritten",
    "Fit",
    "FitWarning",
    "Friction",
    "FunctionError",
    "FunctionsMissing",
    "GrazingType",
    "Guard",
    "Impact",
    "Interrupted",
    "InvalidFile",
    "InvalidParameter",
    "Life",
    "LoadCurve",
    "LyapunovSpectrum",
    "MemsImpactError",
    "Observable",
    "OperatingMap",
    "OptimizationInterrupted",
    "Optimum",
    "Options",
    "Orbit",
    "OrbitError",
    "Run",
    "ParetoFront",
    "Part",
    "PluginWarning",
    "Quantity",
    "Relay",
    "RingDown",
    "RunError",
    "RunInterrupted",
    "ScaleWarning",
    "Scatter",
    "Settling",
    "Sensitivity",
    "SpecialPoint",
    "StartWarning",
    "State",
    "Steps",
    "StiffnessWarning",
    "Stopper",
    "StoredStudy",
    "Stribeck",
    "StudyInterrupted",
    "Surface",
    "SweepInterrupted",
    "System",
    "Target",
    "Term",
    "UnitsWarning",
    "ValidityWarning",
    "Verification",
    "Window",
    "WorkersLost",
    "animate",
    "basins",
    "blows",
    "classify",
    "continue_curve",
    "continue_equilibrium",
    "continue_orbit",
    "duty_cycle",
    "energy",
    "find_equilibria",
    "find_orbit",
    "fit",
    "follow_attractors",
    "frequency_response",
    "grazing_type",
    "impact_onset",
    "kicked",
    "life",
    "load",
    "load_actuator",
    "load_curve",
    "load_drive",
    "lyapunov",
    "load_study",
    "load_system",
    "map_summary",
    "modes",
    "operating_chart",
    "operating_map",
    "margins",
    "optimize",
    "pareto_front",
    "period_one_window",
    "plot_basins",
    "plot_branch",
    "plot_chart",
    "plot_curve",
    "plot_drive",
    "plot_energy",
    "plot_load",
    "plot_map",
    "plot_orbit",
    "plot_response",
    "plot_pareto",
    "plot_run",
    "plot_scatter",
    "plot_sensitivity",
    "plot_sweep",
    "pull_in_voltage",
    "read_study",
    "resolution",
    "resting_voltage",
    "ring_down",
    "scatter",
    "sensitivity",
    "simulate",
    "speed_over_voltage",
    "step_length",
    "step_lengths",
    "style",
    "sweep",
    "sweep_summary",
    "switch_branch",
    "to_xarray",
]

# Where each name lives. Names are imported when they are first used (PEP 562): pandas, numba and
# matplotlib take over a second, which `mems-impact --help` need not wait for.
_HOMES = {
    "actuator.drives": ("Drive", "load_drive", *WAVEFORMS.values()),
    "actuator.terms.base": ("Term",),
    **{f"actuator.terms.{name}": (term,) for name, term in TERMS.items()},
    "actuator.figures.drive": ("plot_drive",),
    "actuator.figures.energy": ("plot_energy",),
    "actuator.figures.load": ("plot_load",),
    "actuator.own_system": ("load_system",),
    "actuator.parameters": ("Actuator", "load_actuator"),
    "actuator.study_file": ("load_study",),
    "engines.options": ("Options",),
    "errors": (
        "EngineUnavailable",
        "FileNotWritten",
        "FunctionError",
        "FunctionsMissing",
        "InvalidFile",
        "InvalidParameter",
        "MemsImpactError",
        "OrbitError",
        "RunError",
        "WorkersLost",
    ),
    "interruptions": (
        "ChartInterrupted",
        "Interrupted",
        "OptimizationInterrupted",
        "RunInterrupted",
        "StudyInterrupted",
        "SweepInterrupted",
    ),
    "plotting.animation": ("Animation", "animate"),
    "plotting.basins": ("plot_basins",),
    "plotting.scatter": ("plot_scatter",),
    "plotting.branch": ("plot_branch",),
    "actuator.figures.chart": ("plot_chart",),
    "analysis.branch": ("Branch", "Steps", "continue_orbit", "switch_branch"),
    "analysis.curve": ("Curve", "continue_curve"),
    "analysis.special": ("GrazingType", "SpecialPoint", "grazing_type"),
    "actuator.design.chart": ("Chart",),
    "actuator.design.charting": ("operating_chart",),
    "analysis.equilibria": ("EquilibriumBranch", "continue_equilibrium"),
    "analysis.equilibrium": ("Equilibrium", "EquilibriumPoint", "find_equilibria"),
    "actuator.verbs": ("find_orbit", "simulate"),
    "analysis.orbit": ("Orbit",),
    "plotting.pareto": ("plot_pareto",),
    "plotting.sensitivity": ("plot_sensitivity",),
    "plotting.style": ("style",),
    "plotting.sweep": ("plot_sweep",),
    "studies.margins": ("margins",),
    "studies.optimize": ("Optimum", "optimize"),
    "studies.pareto": ("ParetoFront", "pareto_front"),
    "studies.sensitivity": ("Sensitivity", "sensitivity"),
    "plotting.curve": ("plot_curve",),
    "plotting.map": ("plot_map",),
    "plotting.orbit": ("plot_orbit",),
    "plotting.run": ("plot_run",),
    "actuator.design.blows": ("Blows", "blows"),
    "actuator.design.energy": ("Energy", "energy"),
    "actuator.design.duty": ("Duty", "duty_cycle"),
    "actuator.design.life": ("Life", "life"),
    "actuator.design.response": ("frequency_response", "impact_onset"),
    "actuator.design.ring_down": ("RingDown", "ring_down"),
    "actuator.figures.response": ("plot_response",),
    "actuator.design.load": ("LoadCurve", "load_curve"),
    "actuator.design.estimates": (
        "pull_in_voltage",
        "resting_voltage",
        "step_length",
        "step_lengths",
    ),
    "actuator.design.speeds": ("resolution", "speed_over_voltage"),
    "actuator.design.window": ("Window", "period_one_window"),
    "actuator.design.fit": ("Fit", "fit"),
    "analysis.parts.friction": ("Friction", "Stribeck"),
    "analysis.parts.part": ("Part",),
    "analysis.parts.relay": ("Relay",),
    "analysis.parts.stopper": ("Stopper",),
    "analysis.parts.surface": ("Surface",),
    "analysis.lyapunov": ("LyapunovSpectrum", "classify", "lyapunov"),
    "analysis.quantity": ("Quantity",),
    "analysis.run": ("Run",),
    "analysis.state": ("State",),
    "actuator.system": ("kicked",),
    "analysis.observable": ("Observable",),
    "analysis.storing.file": ("load",),
    "studies.sweep": ("sweep",),
    "analysis.modes": ("modes",),
    "analysis.system": ("System",),
    "hybrid.automaton": ("Guard", "Impact"),
    "actuator.design.targets": ("Target",),
    "analysis.verification": ("Verification",),
    "analysis.attractor": ("Settling",),
    "studies.basins": ("Basins", "basins"),
    "studies.following": ("AttractorBranches", "follow_attractors"),
    "studies.scatter": ("Scatter", "scatter"),
    "studies.motions": ("map_summary",),
    "studies.operating_map": ("OperatingMap", "operating_map"),
    "studies.stored_study": ("StoredStudy", "read_study"),
    "tables.labelled": ("to_xarray",),
    "tables.sweep": ("sweep_summary",),
    "warnings": (
        "DiscontinuityWarning",
        "EngineFallbackWarning",
        "FitWarning",
        "PluginWarning",
        "ScaleWarning",
        "StartWarning",
        "StiffnessWarning",
        "UnitsWarning",
        "ValidityWarning",
    ),
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("importlib.metadata").version(__name__)
    for home, names in _HOMES.items():
        if name in names:
            value = globals()[name] = getattr(import_module(f"{__name__}.{home}"), name)
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)


if "IPython" in sys.modules:  # a notebook, in which results are shown with their pictures
    import_module(f"{__name__}.notebooks").register()
