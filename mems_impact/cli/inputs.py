"""Inputs of a command: a device, a system, or a study file, and the arguments of a function."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

import click

from mems_impact.cli.arguments import given_arguments
from mems_impact.cli.options import KEY, actuator_from, code_is_allowed, drive_from, option_of
from mems_impact.cli.runtime import FROM_FILE, STORE, warn
from mems_impact.cli.value_types import KICKED, Initial, symbol_of

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi
    from mems_impact.actuator.system import ActuatorSystem

# --- Arguments of functions

RUNNING_ARGUMENTS = ("store", "executor", "workers", "progress")

# Options allowed beside a study file; all others describe the study.
EXCLUSIVE_OPTIONS = (
    *("device", "drive_allow_code", *RUNNING_ARGUMENTS),
    *("output", "figure", "no_figure"),
)


def arguments_for(path: str, owner: mi.HybridSystem | mi.Actuator | None = None) -> dict[str, Any]:
    """Return the arguments that the options of the running command give to a function.

    `path` is ``"package.module:name"``; the initial state belongs to `owner`.
    """
    from mems_impact.studies.engine.config import arguments_from

    table = {name: _symbols(value, owner) for name, value in given_arguments(path).items()}
    initial = table.pop("initial", None)
    arguments = arguments_from(resolve_name(path), table, Path())
    _note_store(click.get_current_context(), arguments)
    if initial is not None and owner is not None:
        arguments["initial"] = start_from(initial, owner)
    return arguments


def study_of(
    ctx: click.Context,
    kind: str,
    path: str,
    options: Mapping[str, Any],
    own_options: Collection[str] = (),
) -> tuple[mi.HybridSystem, dict[str, Any]]:
    """Return system and arguments of the study that a file or the options of a command describe.

    `path` is the function that runs it, ``"package.module:name"``; `options` has the values of
    DEVICE and ``--set``. `own_options` of the command are allowed beside a study file.
    """
    from mems_impact.actuator.device_files import names_in_file

    device = options["device"]
    if "study" in names_in_file(device):
        return _from_file(ctx, device, kind, path, {*EXCLUSIVE_OPTIONS, *own_options})
    axes = map(given_arguments(path, complete=False).get, ("x", "y"))
    varied = {symbol_of(axis[0]): axis[1] for axis in axes if axis is not None}
    actuator = _device(device, options["changes"], varied)
    given_arguments(path)  # before the drive is missed
    system = _driven(actuator, drive_from(varied))
    return system, arguments_for(path, system)


def _from_file(
    ctx: click.Context, file: str, kind: str, path: str, allowed: Collection[str]
) -> tuple[mi.HybridSystem, dict[str, Any]]:
    """Return system and arguments of a study file of a kind, with `allowed` options beside it."""
    import mems_impact as mi
    from mems_impact.studies.engine.config import executor_named

    ctx.meta[FROM_FILE] = True
    for parameter in ctx.command.get_params(ctx):
        source = ctx.get_parameter_source(parameter.name or "")
        if source is click.core.ParameterSource.COMMANDLINE and parameter.name not in allowed:
            option = parameter.opts[0]
            raise click.UsageError(f"{option}: {file} describes the study; omit the option")
    study = mi.load(file, allow_code=code_is_allowed())
    if study.kind != kind:
        raise click.UsageError(
            f"{file} describes a study of another kind; run it by mems-impact {study.kind}"
        )
    given = given_arguments(path, complete=False)
    arguments = study.arguments | {n: given[n] for n in RUNNING_ARGUMENTS if n in given}
    if "executor" in given:
        arguments["executor"] = executor_named(given["executor"], arguments.get("workers"))
    _note_store(ctx, arguments)
    return study.system, arguments


def symbol_for(name: str, owner: mi.HybridSystem | mi.Actuator | None) -> str:
    """Return the symbol of a parameter of a device; a parameter of another system unchanged."""
    from mems_impact.actuator.actuator import Actuator
    from mems_impact.actuator.system import ActuatorSystem

    return symbol_of(name) if isinstance(owner, ActuatorSystem | Actuator) else name


def _symbols(value: Any, owner: mi.HybridSystem | mi.Actuator | None) -> Any:
    """Return an axis, or values by parameter, with the symbols of a device."""
    match value:
        case (str(name), *rest) if isinstance(value, tuple):
            return (symbol_for(name, owner), *rest)
        case dict():
            return {symbol_for(name, owner): each for name, each in value.items()}
    return value


def _note_store(ctx: click.Context, arguments: Mapping[str, Any]) -> None:
    ctx.meta[STORE] = arguments.get("store")


def numbers_of_range(
    actuator: mi.Actuator, field: str, ends: tuple[float | str, float | str, int], unit: str
) -> Any:
    """Return the numbers of a range of a quantity of a device."""
    import numpy as np

    from mems_impact.actuator.parameters import numbers_for

    start, stop = numbers_for(actuator, field, list(ends[:2]), unit)
    return np.linspace(start, stop, ends[2])


def values_of_axis(system: Any, parameter: str, ends: Sequence[Any]) -> Any:
    """Return the values of a range of a parameter of a system."""
    import numpy as np

    start, stop = (system.units.parse(parameter, end, "values") for end in ends[:2])
    return np.linspace(start, stop, ends[2])


def run_saving_partial(run: Callable[[], Any], keep: Callable[[Any], None]) -> Any:
    """Run a study; if it ends early, keep its partial result before raising."""
    import mems_impact as mi

    try:
        return run()
    except (mi.Interrupted, mi.WorkersLost) as error:
        if len(error.partial) > 0:
            keep(error.partial)
        raise


def warn_of_failures(points: pd.DataFrame) -> None:
    """Warn of points that failed, with the first reason."""
    failed = points.loc[points["status"] != "ok", "status"]
    if len(failed):
        warn(f"{len(failed)} of {len(points)} points failed, the first one: {failed.iloc[0]}")


# --- Systems


def device_system(
    device: str, changes: Mapping[str, float], varied: Mapping[str, float] | None = None
) -> ActuatorSystem:
    """Return a device, by name or file with `changes` of ``--set``, under the drive of the options.

    `varied` has a value of each varied parameter, which replaces its option. The device may lack
    the term of the parameter.
    """
    return _driven(_device(device, changes, varied or {}), drive_from(varied))


def _driven(actuator: mi.Actuator, drive: mi.Drive) -> ActuatorSystem:
    """Return a device under a drive; an error of the drive names the drive."""
    from mems_impact.errors import InvalidParameter

    try:
        return actuator.under(drive)
    except InvalidParameter as error:
        fields = type(drive).model_fields
        raise error.located(owner="drive" if error.field in fields else "") from None


def _device(device: str, changes: Mapping[str, float], varied: Mapping[str, float]) -> mi.Actuator:
    """Return a device with the terms whose parameters are varied."""
    terms = {name: value for name, value in varied.items() if "." in name}
    return actuator_from(device, {**terms, **changes})


def load_subject(
    name: str, changes: Mapping[str, float], varied: Mapping[str, float] | None = None
) -> mi.HybridSystem:
    """Return the system of a name or path: a device, or any file that `mems_impact.load` takes.

    Parameters are those of `device_system`.
    """
    from mems_impact.actuator.system_files import is_system_name, load_system

    if not is_system_name(name) or Path(name).exists():
        return device_system(name, changes, varied)
    refuse_drive(name)
    return load_system(name).changed(**changes) if changes else load_system(name)


def start_from(initial: Initial, owner: mi.HybridSystem | mi.Actuator) -> mi.State:
    """Return the initial state that ``--initial`` describes."""
    import mems_impact as mi
    from mems_impact.actuator.equations import STATES
    from mems_impact.actuator.system import ActuatorSystem

    if isinstance(owner, ActuatorSystem):
        owner = owner.actuator
    if isinstance(owner, mi.Actuator):
        if initial == KICKED:
            return mi.kicked_state(owner)
        allowed, start = [*STATES, "time"], mi.State()
    else:
        allowed, start = [*owner.states, "time"], owner.initial
    if initial == KICKED:
        raise click.UsageError(f"--initial {KICKED}: for devices only; give NAME=NUMBER")
    for component in initial:
        if component not in allowed:
            raise click.UsageError(f"--initial {component}: must be one of {', '.join(allowed)}")
    return start.replace(**initial)


def refuse_drive(name: str) -> None:
    """Raise an error if options of a drive are given together with a system of this name."""
    for option, value in click.get_current_context().meta.get(KEY, {}).items():
        if value is not False:  # a flag that was not given
            raise click.UsageError(f"{option_of(option)}: for devices only; {name} has no voltage")
