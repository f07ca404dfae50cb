"""Serialization of the results of this subpackage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from mems_impact._util.units import Scales
from mems_impact.analysis import (
    branch,
    curve,
    edge_state,
    equilibrium,
    lyapunov,
    manifold,
    orbit,
    run,
    settling,
    special_points,
    verification,
)
from mems_impact.analysis.user_test_functions import EventFunction
from mems_impact.continuation.branch import (
    BranchEvent,
    BranchPoint,
    CurveEvent,
    EquilibriumBranch,
    EquilibriumCurve,
    OrbitBranch,
    OrbitCurve,
)
from mems_impact.continuation.homoclinic import SlowPassage
from mems_impact.continuation.test_functions import ORBIT_TESTS
from mems_impact.continuation.user_test_functions import FunctionTest
from mems_impact.hybrid.definition import Typical
from mems_impact.hybrid.simulation import Events, Samples, Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import Arc, Event
from mems_impact.integrators.options import Options
from mems_impact.orbits.equilibrium import EquilibriumEvaluation, EquilibriumState
from mems_impact.orbits.family import ParameterPoint
from mems_impact.orbits.periodic_orbit import AdmissibilityViolation, PeriodicOrbit
from mems_impact.orbits.shooting import Phase, Shooting, ShootingEvaluation
from mems_impact.orbits.signature import Segment
from mems_impact.systems import state, statistics
from mems_impact.systems.base import HybridSystem, SystemFamily
from mems_impact.systems.serialization.codec import Reader, register
from mems_impact.systems.serialization.detached import DetachedSystem, check_same_system, describe
from mems_impact.systems.system import System
from mems_impact.systems.window_statistics import Moments, TimeWindow

TRAJECTORY = ("start", "final", "events", "steps", "arcs", "ended", "checkpoints", "implicit_arcs")


def restored(description: Mapping[str, Any], reader: Reader) -> HybridSystem:
    """Return the system of a description: the user's own at these parameters, if given."""
    if reader.system is None:
        return DetachedSystem(description, reader.path)
    check_same_system(reader.system, description, reader.path)
    system: HybridSystem = reader.system.restored(
        description["parameters"], description["scales"], description.get("typical")
    )
    return system


def variables(value: Any) -> Mapping[str, Any]:
    """Return all attributes of an object."""
    return vars(value)


def register_object(kind: type) -> None:
    """Register a class whose objects consist of their attributes."""

    def constructor(**values: Any) -> Any:
        value: Any = object.__new__(kind)
        vars(value).update(values)
        return value

    register(kind, parts=variables, constructor=constructor)


def register_run(kind: type[run.Run]) -> None:
    """Register a class of runs, stored without the problem, which their system provides."""

    def parts(value: run.Run) -> Mapping[str, Any]:
        return {
            **{name: getattr(value, name) for name in ("system", "options", "keep", "window")},
            "ended": value.ended,
            "trajectory": {name: getattr(value.trajectory, name) for name in TRAJECTORY},
            "gatherer": value._accumulator,
        }

    def constructor(trajectory: Mapping[str, Any], gatherer: Any, **values: Any) -> run.Run:
        problem = values["system"].problem(values["options"])
        if isinstance(gatherer, statistics.RunStatistics):
            gatherer.resume(values["system"].statistics, problem)
        restored = Trajectory(problem=problem, **trajectory)
        return kind(trajectory=restored, _gatherer=gatherer, **values)

    register(kind, parts=parts, constructor=constructor)


register(System, parts=lambda system: describe(system, system.functions), reading=restored)
register(DetachedSystem, "System", parts=lambda system: system.description, reading=restored)
register(SystemFamily)
register(Typical)
register(Scales, parts=lambda scales: {"factors": scales.factors, "named": scales.named},
         constructor=lambda factors, named: Scales.of(factors, named))  # fmt: skip
register(
    state.State,
    parts=lambda each: {"parts": each.parts()},
    constructor=lambda parts: state.state_from(*parts),
)
register(
    special_points.GrazingType,
    parts=lambda each: {"value": each.value},
    constructor=special_points.GrazingType,
)
register(
    Shooting,
    parts=lambda s: {"family": s.family, "segments": s.segments, "active": s.active,
                     "pinned": tuple(s.pinned.items()), "phase": s.phase, "nodes": s.nodes},
    constructor=lambda pinned, **rest: Shooting(pinned=dict(pinned), **rest),
)  # fmt: skip
register_run(run.Run)
KINDS: tuple[type, ...] = (
    settling.Settling, settling.SettlingRow,
    Options, HybridState, Events, Samples, Arc, Event, AdmissibilityViolation,
    ShootingEvaluation, ParameterPoint, Segment, Phase,
    BranchPoint, OrbitBranch, SlowPassage, OrbitCurve,
    TimeWindow, orbit.Orbit, branch.Branch, special_points.SpecialPoint,
    special_points.CodimensionTwo, curve.Curve, verification.Verification, EquilibriumEvaluation,
    EquilibriumState, EquilibriumBranch, EquilibriumCurve,
    equilibrium.Equilibrium,
    lyapunov.LyapunovSpectrum,
    manifold.Manifold, edge_state.EdgeState,
)  # fmt: skip


def periodic_orbit(**parts: Any) -> PeriodicOrbit:
    """Return a periodic orbit whose arcs and events are those of its segments."""
    orbit = PeriodicOrbit(**parts)
    point, count = orbit.point, len(orbit.segments)
    if {len(point.arcs), len(point.events), len(point.starts), len(point.ends)} != {count}:
        raise ValueError(f"an orbit of {count} segments has other numbers of arcs and events")
    return orbit


register(PeriodicOrbit, constructor=periodic_orbit)
for kind in (*KINDS, *ORBIT_TESTS, FunctionTest):
    register(kind)
register(  # without the function of the user
    EventFunction, parts=lambda each: {f.name: getattr(each, f.name) for f in fields(each)[:-1]}
)
register(BranchEvent)
register(CurveEvent)
register_object(Moments)
register(
    statistics.RunStatistics,
    parts=lambda each: each.gathered(),
    constructor=statistics.RunStatistics.of,
)
