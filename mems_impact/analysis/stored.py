"""What of the generic rooms may stand in a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mems_impact.analysis import (
    branch,
    curve,
    equilibria,
    equilibrium,
    lyapunov,
    orbit,
    run,
    special,
    state,
    statistics,
    verification,
)
from mems_impact.analysis.build import Build
from mems_impact.analysis.detached import DetachedSystem, check_same, description
from mems_impact.analysis.moments import Moments
from mems_impact.analysis.storing.coding import Reader, register
from mems_impact.analysis.system import System
from mems_impact.continuation.branch import BranchEvent, BranchPoint, OrbitBranch
from mems_impact.continuation.curve import CurveEvent, CurvePoint, OrbitCurve
from mems_impact.continuation.equilibria import Equilibria, EquilibriumEvent
from mems_impact.continuation.monitors import Monitor
from mems_impact.engines.options import Options
from mems_impact.hybrid.scaling import Typical
from mems_impact.hybrid.trajectory import Events, Instant, Trajectory
from mems_impact.hybrid.variational import Arc, Event
from mems_impact.orbits.equilibrium import Balance, StationaryState
from mems_impact.orbits.family import Family
from mems_impact.orbits.orbit import Defect, PeriodicOrbit
from mems_impact.orbits.phase import Phase
from mems_impact.orbits.setting import Setting
from mems_impact.orbits.shooting import Point, Shooting
from mems_impact.orbits.signature import Segment
from mems_impact.units import Scales

__all__ = ["register_run", "restored", "variables"]

TRAJECTORY = ("start", "final", "events", "steps", "arcs", "ended", "implicit_arcs")


def restored(told: Mapping[str, Any], reader: Reader) -> System:
    """Return the system of a description: the user's own, at these parameters, if it is given."""
    if reader.system is None:
        return DetachedSystem(told, reader.path)
    check_same(reader.system, told, reader.path)
    system: System = reader.system.restored(told["parameters"], told["scales"], told.get("typical"))
    return system


def variables(value: Any) -> Mapping[str, Any]:
    """Return all that an object holds."""
    return vars(value)


def register_object(kind: type, name: str = "") -> None:
    """Let the objects of a class be stored that have no more to them than their variables."""

    def whole(**found: Any) -> Any:
        value: Any = object.__new__(kind)
        vars(value).update(found)
        return value

    register(kind, name, parts=variables, whole=whole)


def register_run(kind: type[run.Run]) -> None:
    """Let the runs of a class be stored: without the problem, which their system makes."""

    def parts(value: run.Run) -> Mapping[str, Any]:
        return {
            **{name: getattr(value, name) for name in ("system", "options", "keep", "window")},
            "ended": value.ended,
            "trajectory": {name: getattr(value.trajectory, name) for name in TRAJECTORY},
            "gatherer": value.gatherer,
        }

    def whole(trajectory: Mapping[str, Any], gatherer: Any, **found: Any) -> run.Run:
        problem = found["system"].problem(found["options"])
        if isinstance(gatherer, statistics.Gathering):
            gatherer.resume(found["system"], problem)
        made = Trajectory(problem=problem, **trajectory)
        return kind(trajectory=made, _gatherer=gatherer, **found)

    register(kind, parts=parts, whole=whole)


register(System, parts=lambda system: description(system, system.functions), reading=restored)
register(DetachedSystem, "System", parts=lambda system: system.description, reading=restored)
register(Build)
register(Typical)
register(Scales, parts=lambda scales: {"factors": scales.factors, "named": scales.named},
         whole=lambda factors, named: Scales.of(factors, named))  # fmt: skip
register(
    state.State,
    parts=lambda each: {"values": each.as_dict(), "time": each.time, "mode": each.mode},
    whole=lambda values, time, mode: state.state_from(values, time, mode),
)
register(
    special.GrazingType,
    parts=lambda each: {"value": each.value},
    whole=special.GrazingType,
)
register(
    Shooting,
    parts=lambda s: {"family": s.family, "segments": s.segments, "active": s.active,
                     "pinned": tuple(s.pinned.items()), "phase": s.phase},
    whole=lambda pinned, **rest: Shooting(pinned=dict(pinned), **rest),
)  # fmt: skip
register_run(run.Run)
KINDS: tuple[type, ...] = (
    Options, Instant, Events, Arc, Event, Family, Defect, PeriodicOrbit, Point, Setting, Segment,
    Phase, Monitor,
    BranchPoint, OrbitBranch, CurvePoint, OrbitCurve,
    statistics.Span, orbit.Orbit, branch.Branch, special.SpecialPoint, special.CodimensionTwo,
    curve.Curve, verification.Verification, Balance, StationaryState, Equilibria, EquilibriumEvent,
    equilibrium.Equilibrium, equilibrium.EquilibriumPoint, equilibria.EquilibriumBranch,
    lyapunov.LyapunovSpectrum,
)  # fmt: skip
for kind in KINDS:
    register(kind)
register(BranchEvent)
register(CurveEvent)
register_object(Moments)
register_object(statistics.Anchors)
register(
    statistics.Gathering,
    parts=lambda each: each.gathered(),
    whole=statistics.Gathering.of,
)
