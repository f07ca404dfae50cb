"""Serialization of actuators, drives and their results in result files."""

from __future__ import annotations

from collections.abc import Mapping
from types import FunctionType
from typing import Any

import numpy as np

from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.design.characteristic import Characteristic
from mems_impact.actuator.design.closing import Closing
from mems_impact.actuator.design.duty_cycle import DutyCycle
from mems_impact.actuator.design.energy import Energy, WorkSums
from mems_impact.actuator.design.force_curve import ForceCurve
from mems_impact.actuator.design.operating_chart import OperatingChart
from mems_impact.actuator.design.ring_down import RingDown
from mems_impact.actuator.design.soft_landing import SoftLanding
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.drives.files import drive_of_kind
from mems_impact.actuator.drives.pulse_and_hold import PulseAndHold
from mems_impact.actuator.geometry.geometry import Geometry
from mems_impact.actuator.impact_statistics import BlowCounter, RestDetector
from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun
from mems_impact.actuator.statistics import Accumulator
from mems_impact.actuator.system import ActuatorSystem, kind_of
from mems_impact.actuator.terms.files import table_of as term_table
from mems_impact.actuator.terms.files import term_of
from mems_impact.actuator.units import SCALES, DeviceScales
from mems_impact.analysis.serialization import register_object, register_run, restored
from mems_impact.hybrid.pickling import reference
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.serialization.codec import Reader, register
from mems_impact.systems.serialization.detached import check_same_system, describe


def table_of(drive: Drive) -> dict[str, Any]:
    """Return a drive as the table ``[drive]`` of a file, with functions as references."""
    table: dict[str, Any] = {"kind": kind_of(drive)}
    for name in type(drive).model_fields:
        value = getattr(drive, name)
        if isinstance(value, Drive):
            value = table_of(value)
        elif isinstance(value, FunctionType):
            value = reference(value)
        elif isinstance(value, tuple) and value and isinstance(value[0], float):
            value = np.array(value)
        table[name] = value
    return table


def drive_of(table: Mapping[str, Any]) -> Drive:
    """Return the drive of a table without functions."""
    values = {name: value for name, value in table.items() if name != "kind"}
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            values[name] = tuple(value.tolist())
        elif isinstance(value, Mapping):
            values[name] = drive_of(value)
    return drive_of_kind(table["kind"])(**values)


def actuator_parts(actuator: Actuator) -> dict[str, Any]:
    """Return a device as the tables of a file."""
    terms = {term.name(): term_table(term) for term in actuator.terms}
    values = {name: value for name, value in dict(actuator).items() if name != "terms"}
    if actuator.geometry is not None:
        values["geometry"] = actuator.geometry.as_table()
    return {**values, "terms": terms} if terms else values


def actuator_of(parts: Mapping[str, Any]) -> Actuator:
    """Return the device of the tables of a file."""
    terms = tuple(term_of(name, table) for name, table in parts.get("terms", {}).items())
    values: dict[str, Any] = {**parts, "terms": terms}
    if "geometry" in values:
        values["geometry"] = Geometry(**values["geometry"])
    return Actuator(**values)


def _parts(system: ActuatorSystem) -> dict[str, Any]:
    has_functions = not system.is_data_only
    return {
        "actuator": actuator_parts(system.actuator),
        "drive": table_of(system.drive),
        "scales": system.units.scales,
        "with energy": system.includes_energy,
        "description": describe(system, system.functions) if has_functions else None,
    }


def _system(parts: dict[str, Any], reader: Reader) -> HybridSystem:
    if parts["description"] is not None:
        system: Any = restored(parts["description"], reader)
    else:
        system = ActuatorSystem(actuator_of(parts["actuator"]), drive_of(parts["drive"]))
        system = system.restored({}, parts["scales"])
        if reader.system is not None:
            check_same_system(reader.system, describe(system, {}), reader.path)
    is_accounted = parts["with energy"] and isinstance(system, ActuatorSystem)
    return system.with_energy() if is_accounted else system


register(ActuatorSystem, parts=_parts, reading=_system)
register(Actuator, parts=actuator_parts, reading=lambda parts, reader: actuator_of(parts))
register(PulseAndHold, parts=table_of, reading=lambda parts, reader: drive_of(parts))
register(DeviceScales, parts=lambda scales: {name: getattr(scales, name) for name in SCALES})
register_run(ActuatorRun)
register(ActuatorOrbit)
register(OperatingChart)
register(Energy)
register(ForceCurve)
register(DutyCycle)
register(Characteristic)
register(RingDown)
register(Closing)
register(SoftLanding)
register(WorkSums)
register_object(Accumulator)
register_object(BlowCounter)
register_object(RestDetector)
