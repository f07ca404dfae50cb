"""Inputs of a command: a device, a system, or a study file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING, Any

import click

from mems_impact.cli.options import (
    KEY,
    KICKED,
    Initial,
    actuator_from,
    code_is_allowed,
    drive_from,
    option_of,
    state_from,
)
from mems_impact.cli.runtime import STORE, warn
from mems_impact.cli.wording import FROM_FILE

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi

# --- Study files and options of studies

# Options allowed beside a study file; all others describe the study.
EXCLUSIVE_OPTIONS = (
    *("device", "drive_allow_code", "store", "executor", "workers"),
    *("progress", "output", "figure", "no_figure"),
)


def from_file(
    ctx: click.Context, path: str, kind: str, allowed_options: Collection[str] = ()
) -> tuple[mi.HybridSystem, dict[str, Any]]:
    """Return system and arguments of a study file of a kind, with `allowed_options` beside it."""
    import mems_impact as mi

    ctx.meta[FROM_FILE] = True
    allowed = {*EXCLUSIVE_OPTIONS, *allowed_options}
    for parameter in ctx.command.params:
        source = ctx.get_parameter_source(parameter.name or "")
        if source is click.core.ParameterSource.COMMANDLINE and parameter.name not in allowed:
            option = parameter.opts[0]
            raise click.UsageError(f"{option}: {path} describes the study; omit the option")
    study = mi.load(path, allow_code=code_is_allowed())
    if study.kind != kind:
        raise click.UsageError(
            f"{path} describes a study of another kind; run it by mems-impact {study.kind}"
        )
    if ctx.meta.get(STORE) is None:
        ctx.meta[STORE] = study.arguments.get("store")
    return study.system, study.arguments


def study_of(
    ctx: click.Context,
    options: Mapping[str, Any],
    kind: str,
    own_arguments: Callable[[], Mapping[str, Any]],
    *,
    varied: Mapping[str, float] | None = None,
    allowed_options: Collection[str] = (),
) -> tuple[mi.HybridSystem, dict[str, Any]]:
    """Return system and arguments of the study that the options of a command describe.

    Parameters
    ----------
    ctx : click.Context
    options : mapping of str to object
        `device_options`, `initial_option`, `recurrence_options`, `study_integrator_options` and
        `study_options`, with their values.
    kind : str
        Kind of the study.
    own_arguments : callable
        Returns the arguments specific to this kind; not called for a study file.
    varied : mapping of str to float, optional
        Varied parameters and their first values.
    allowed_options : collection of str, optional
        Options of the command that are allowed beside a study file.
    """
    from mems_impact.actuator.parameters import names_in_file

    device, varied = options["device"], varied or {}
    if "study" in names_in_file(device):
        system, arguments = from_file(ctx, device, kind, allowed_options)
    else:
        # The device may lack the term whose parameter is varied.
        terms = {name: value for name, value in varied.items() if "." in name}
        actuator = actuator_from(device, {**terms, **options["changes"]})
        arguments = {**own_arguments(), **_recurrence_and_integrator(options)}
        system = actuator.under(drive_from(varied))
        if options["initial"]:
            arguments["initial"] = state_from(options["initial"], actuator)
    add_running(arguments, options)
    return system, arguments


def _recurrence_and_integrator(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments from `recurrence_options` and the options of the integrator."""
    import mems_impact as mi

    names = ("transient", "periods", "longest", "tolerance", "exponents", "chaos_persistence")
    return {
        "recurrence": mi.RecurrenceOptions(**{name: values[name] for name in names}),
        "options": values["options"],
    }


def add_running(arguments: dict[str, Any], options: Mapping[str, Any]) -> None:
    """Add the values of `study_options` to the arguments of a study."""
    from mems_impact.studies.engine.config import executor_named

    for name in ("store", "workers"):
        if options[name] is not None:
            arguments[name] = options[name]
    if options["executor"] is not None:
        arguments["executor"] = executor_named(options["executor"], arguments.get("workers"))


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


def load_subject(
    name: str,
    changes: Mapping[str, float],
    initial: Initial,
    varied: Mapping[str, float] | None = None,
) -> tuple[mi.HybridSystem, mi.State | None]:
    """Return the system of a name or path, and its initial state; None for the default state.

    Parameters
    ----------
    name : str
        Name of a device, or of a system as `mems_impact.load` takes it.
    changes : mapping of str to float
        Values of ``--set``.
    initial : mapping of str to float or "kicked"
        Value of ``--initial``.
    varied : mapping of str to float, optional
        A value of the parameter that a command varies, which replaces its option.
    """
    from pathlib import Path

    from mems_impact.actuator.system_files import is_system_name, load_system

    if not is_system_name(name) or Path(name).exists():
        actuator = actuator_from(name, dict(changes))
        return actuator.under(drive_from(varied)), state_from(initial, actuator)
    refuse_drive(name)
    if initial == KICKED:
        raise click.UsageError(f"--initial {KICKED}: for devices only; {name} takes NAME=NUMBER")
    assert isinstance(initial, dict)
    system = load_system(name).changed(**changes) if changes else load_system(name)
    if not initial:
        return system, None
    for component in initial:
        allowed = (*system.states, "time")
        if component not in allowed:
            raise click.UsageError(f"--initial {component}: must be one of {', '.join(allowed)}")
    start: mi.State = system.initial.replace(**initial)
    return system, start


def refuse_drive(name: str) -> None:
    """Raise an error if options of a drive are given together with a system of this name."""
    for option, value in click.get_current_context().meta.get(KEY, {}).items():
        if value is not False:  # a flag that was not given
            raise click.UsageError(f"{option_of(option)}: for devices only; {name} has no voltage")
