"""Script, picture and file of a page."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from pprint import pformat
from typing import Any

import numpy as np

import mems_impact as mi
from mems_impact.actuator.serialization import actuator_parts, table_of
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.run import Run
from mems_impact.explorer.session import (
    EXPLORER_OPTIONS,
    PageSetting,
    SliderSpec,
    Subject,
    unit_of_time,
)
from mems_impact.explorer.snapshot import FINE, run_length, sweep_arguments
from mems_impact.systems.base import HybridSystem

PICTURE_DPI = 200
LINE = 96


def python_of(subject: Subject, setting: PageSetting, spec: SliderSpec | None) -> str:
    """Return a script that computes and draws run, orbit and diagram of a setting.

    `spec` is the slider of the diagram's parameter; None for a system without parameters.
    """
    system = setting.system(subject)
    length_arguments: dict[str, Any] = run_length(system, setting, unit_of_time(system))
    arguments = [f"{name}={value!r}" for name, value in length_arguments.items()]
    if setting.start == "kicked":
        arguments.append("initial=mi.kicked_state(actuator)")
    options = _options(subject)
    lines = [
        *(["import numpy as np", ""] if spec is not None else []),
        "import mems_impact as mi",
        "",
        subject.source(system),
        f"run = mi.simulate(system, {', '.join((*arguments, *options))})",
        "print(run.statistics)",
        'mi.plot_run(run).figure.savefig("run.png", dpi=200)',
    ]
    if spec is not None:
        lines += ["", *_sweep(system, setting, spec, options)]
    lines += [
        "",
        "try:",
        "    orbit = mi.find_orbit(run)",
        "    print(orbit, orbit.multipliers)",
        "except mi.OrbitError as error:",
        "    print(error)",
    ]
    return "\n".join(lines) + "\n"


def run_picture(run: Run) -> bytes:
    """Return the figure of `mems_impact.plot_run` as PNG."""
    buffer = io.BytesIO()
    mi.plot_run(run).figure.savefig(buffer, format="png", dpi=PICTURE_DPI)
    return buffer.getvalue()


def device_file(subject: Subject, system: ActuatorSystem) -> str:
    """Return device and drive as a TOML file, for `load`.

    A drive of user functions is omitted.
    """
    parameters = actuator_parts(system.actuator)
    units, terms = parameters.pop("units", "dimensionless"), parameters.pop("terms", {})
    head = {"name": subject.title, "description": "saved by mems-impact explore", "units": units}
    tables: dict[str, Any] = {"parameters": parameters, **terms}
    if system.is_data_only:
        tables["drive"] = table_of(system.drive)
    return "\n".join([*_entries(head), *_tables(tables)]) + "\n"


def _options(subject: Subject) -> list[str]:
    options = subject.options
    if options == EXPLORER_OPTIONS:
        return [f"options=mi.Options(method={options.method!r})"]
    return [f"options=mi.{options!r}"]


def _sweep(
    system: HybridSystem, setting: PageSetting, spec: SliderSpec, options: list[str]
) -> Iterator[str]:
    arguments = sweep_arguments(system, setting, spec, FINE)
    name, values = arguments.pop("parameter"), arguments.pop("values")
    low, high = float(values[0]), float(values[-1])
    more = [f"{key}={value!r}" for key, value in arguments.items()]
    yield f"values = np.linspace({low!r}, {high!r}, {len(values)})"
    yield f"sweep = mi.sweep(system, {name!r}, values, {', '.join((*more, *options))})"
    yield 'mi.plot_sweep(sweep).figure.savefig("sweep.png", dpi=200)'


def _tables(tables: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    for name, table in tables.items():
        yield ""
        yield f"[{name}]"
        yield from _entries(table)
        within = {key: value for key, value in table.items() if isinstance(value, Mapping)}
        yield from _tables({f"{name}.{key}": value for key, value in within.items()})


def _entries(table: Mapping[str, Any]) -> Iterator[str]:
    for name, value in table.items():
        if not isinstance(value, Mapping) and value is not None:
            yield f"{name} = {_value(value)}"


def _value(value: Any) -> str:
    """Return a value in TOML; numbers with all digits, strings as in JSON."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return pformat([_Plain(_value(each)) for each in value], width=LINE, compact=True)
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else repr(value)


class _Plain(str):
    """Text whose repr is the text itself."""

    def __repr__(self) -> str:
        return str(self)
