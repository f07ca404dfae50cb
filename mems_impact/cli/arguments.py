"""Options of a command that are the arguments of a function.

A command has an option for each argument of a type in `OPTION_TYPES`, described by the first
sentence of the argument's docstring.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import click
from click.core import ParameterSource

from mems_impact.cli.runtime import DRIVE_PREFIX, quiet
from mems_impact.cli.signatures import REQUIRED, Argument, arguments_of
from mems_impact.cli.value_types import (
    KICKED,
    DistributionType,
    InitialType,
    NumberType,
    QuantityType,
    RangeType,
    ToleranceType,
)
from mems_impact.studies.engine import EXECUTORS

GIVEN = "mems_impact.arguments"  # in the context of click: those given, by function

OPTION_NAMES = {
    # `--tolerance` is that of a parameter.
    ("recurrence", "tolerance"): "--recurrence-tolerance",
    ("", "tolerances"): "--tolerance",
    ("", "inputs"): "--input",
}
"""Options by owner and name of an argument, where their names differ."""

SUITED_METHOD = "adams; auto with a term that may be stiff"

Collect = Callable[[Any], Any]


def _state(pairs: tuple[tuple[str, Any], ...]) -> Any:
    """Return the components of a state, or kicked."""
    return KICKED if dict(pairs) == {KICKED: None} else dict(pairs)


def _bounds(ranges: tuple[tuple[str, Any, Any], ...]) -> dict[str, list[Any]]:
    return {name: list(ends) for name, *ends in ranges}


# By type: the option's type, and how the values of a repeatable option are collected. A type that
# is missing has no option.
OPTION_TYPES: dict[str, tuple[Any, Collect | None]] = {
    "State": (InitialType(), _state),
    "Executor": (click.Choice(EXECUTORS), None),
    "os.PathLike[str]": (click.Path(), None),
    "Sequence[str]": (str, list),
    "Collection[str]": (str, list),
    "Mapping[str, tuple[float, float]]": (RangeType(), _bounds),
    "Mapping[str, tuple[float | str, float | str]]": (RangeType(), _bounds),
    "Mapping[str, tuple[float | None, float | None]]": (RangeType(half_open=True), _bounds),
    "Mapping[str, float | str]": (ToleranceType(), dict),
    "Mapping[str, Any]": (DistributionType(), dict),
    "tuple[str, ArrayLike]": (RangeType(points=True), None),
    "tuple[float, float]": (RangeType(named=False), None),
    "tuple[float | None, float | None]": (RangeType(named=False, half_open=True), None),
    "bool": (bool, None),
    "int": (int, None),
    "float": (NumberType(), None),
    "str": (str, None),
}


class FunctionOptions(click.Option):
    """The options of a command that are arguments of a function; see `Command`.

    `declarations` name this object in the list of the command's options, `path` the function,
    ``"package.module:name"``. Arguments in `omit` have no option; `defaults` are those of the
    command that differ from the function's.
    """

    def __init__(
        self,
        declarations: Sequence[str],
        *,
        path: str,
        omit: Sequence[str] = (),
        defaults: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(declarations)
        self.path, self.omit, self.defaults = path, omit, defaults or {}

    @cached_property
    def arguments(self) -> dict[str, Argument]:
        """The arguments that have an option, by the option."""
        found = {}
        for argument in arguments_of(self.path):
            omitted = argument.name in self.omit or argument.owner in self.omit
            if not omitted and _option_type(argument) is not None:
                key = argument.owner, argument.name
                option = OPTION_NAMES.get(key, f"--{argument.name.replace('_', '-')}")
                default = self.defaults.get(argument.name, argument.default)
                found[option] = argument._replace(default=default)
        return found

    @cached_property
    def options(self) -> list[click.Parameter]:
        """The options."""
        return [self._option(name, argument) for name, argument in self.arguments.items()]

    def _option(self, name: str, argument: Argument) -> click.Option:
        if argument.name == "progress":
            return self._progress_option(argument)
        option_type = _option_type(argument)
        assert option_type is not None
        kind, collect = option_type
        several = collect is not None
        default = None if argument.default in (REQUIRED, (), {}, "") else argument.default
        if kind is bool and default:
            name += f"/--no-{name.removeprefix('--')}"
        shown: bool | str = default is not None and default is not False
        if argument.name == "method" and not shown:
            shown = SUITED_METHOD
        text = re.sub("^Whether to (.)", lambda match: match[1].upper(), argument.text)
        help_text = [text, getattr(kind, "hint", ""), "May be repeated." * several]
        return click.Option(
            [name],
            type=kind,
            is_flag=kind is bool,
            multiple=several,
            metavar="NAME" if several and kind is str else None,
            default=default,
            show_default=shown,
            help=" ".join(filter(None, help_text)),
            expose_value=False,
            callback=self._callback(argument, collect, argument.name in self.defaults),
        )

    def _progress_option(self, argument: Argument) -> click.Option:
        def wanted(requested: bool | None) -> bool:
            return not quiet() if requested is None else requested

        return click.Option(
            ["--progress/--no-progress"],
            default=None,
            show_default="progress, unless --quiet",
            help="Show progress: a bar on a terminal, otherwise a line at intervals.",
            expose_value=False,
            callback=self._callback(argument, wanted, True),
        )

    def _callback(
        self, argument: Argument, collect: Collect | None, always: bool
    ) -> Callable[[click.Context, click.Parameter, Any], None]:
        """Return a callback that keeps a value that was given, or `always`."""

        def keep(ctx: click.Context, parameter: click.Parameter, value: Any) -> None:
            source = ctx.get_parameter_source(parameter.name or "")
            if always or source is not ParameterSource.DEFAULT:
                table = ctx.meta.setdefault(GIVEN, {}).setdefault(self.path, {})
                if argument.owner:
                    table = table.setdefault(argument.owner, {})
                table[argument.name] = value if collect is None else collect(value)

        return keep


def _option_type(argument: Argument) -> tuple[Any, Collect | None] | None:
    """Return type and collection of an argument's option; None if it has no option."""
    if argument.choices and "bool" not in argument.types:
        return click.Choice(argument.choices), None
    if {"float", "str"} <= {*argument.types}:
        return QuantityType(), None
    return next((OPTION_TYPES[each] for each in OPTION_TYPES if each in argument.types), None)


class Command(click.Command):
    """A command whose `FunctionOptions` stand for the options of a function.

    They are made when the command runs or shows its help, not when all commands are listed.
    """

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return all options."""
        return [
            option
            for each in super().get_params(ctx)
            for option in (each.options if isinstance(each, FunctionOptions) else [each])
        ]


def function_options(path: str, **attributes: Any) -> Callable[[Any], Any]:
    """Return a decorator that adds the options of a function; see `FunctionOptions`."""
    name = path.rpartition(":")[2].replace(".", "-")
    return click.option(f"--{name}", cls=FunctionOptions, path=path, **attributes)


def given_arguments(path: str, *, complete: bool = True) -> dict[str, Any]:
    """Return the arguments of a function that options give, fields of an options object below it.

    Raises click.UsageError if a required argument is not given, unless `complete` is False.
    """
    context = click.get_current_context()
    given: dict[str, Any] = dict(context.meta.get(GIVEN, {}).get(path, {}))
    for option, argument in _arguments(context.command, path).items():
        if complete and argument.default is REQUIRED and argument.name not in given:
            raise click.UsageError(f"missing option '{option}'")
    return given


def option_of_field(command: click.Command, field: str) -> str:
    """Return the field of an error with the option in place of the argument that it sets."""
    for option, argument in _arguments(command).items():
        for name in (f"{argument.owner}.{argument.name}", argument.name):
            if field == name or field.startswith((f"{name}.", f"{name} ")):
                return f"{option} {field[len(name) :].lstrip('. ')}".rstrip()
    options = {each.name: each.opts[0] for each in command.params if isinstance(each, click.Option)}
    of_drive = f"{DRIVE_PREFIX}{field.removeprefix('drive.')}"
    return options.get(field, options.get(of_drive, field))


def _arguments(command: click.Command, path: str = "") -> dict[str, Argument]:
    """Return the arguments that the options of a command give, of one function or of all."""
    return {
        option: argument
        for each in command.params
        if isinstance(each, FunctionOptions) and path in (each.path, "")
        for option, argument in each.arguments.items()
    }
