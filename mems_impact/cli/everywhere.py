"""Options that every command has: how it tells what it has found."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import click

__all__ = ["as_json", "quiet", "with_options"]

_JSON, _QUIET = "mems_impact.json", "mems_impact.quiet"


def as_json() -> bool:
    """Return whether the running command shall tell what it has found as one JSON document."""
    return _asked(_JSON)


def quiet() -> bool:
    """Return whether the running command shall say nothing but errors."""
    return _asked(_QUIET)


def _asked(key: str) -> bool:
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(key))


def _note(key: str) -> Callable[[click.Context, click.Parameter, bool], None]:
    def note(ctx: click.Context, _parameter: click.Parameter, asked: bool) -> None:
        ctx.meta[key] = asked
        if asked and key == _QUIET:
            _mute(ctx)

    return note


def _mute(ctx: click.Context) -> None:
    """Let nobody hear the package's log while the command runs."""
    log, nobody = logging.getLogger("mems_impact"), logging.NullHandler()
    before = log.propagate
    log.addHandler(nobody)
    log.propagate = False

    def unmute() -> None:
        log.removeHandler(nobody)
        log.propagate = before

    ctx.call_on_close(unmute)


def _flag(name: str, key: str, text: str) -> click.Option:
    # Eager, since defaults of others hang on it.
    flags: dict[str, Any] = {"is_flag": True, "is_eager": True, "expose_value": False}
    return click.Option([name], callback=_note(key), help=text, **flags)


_OPTIONS = (
    _flag("--json", _JSON, "Show all that was found as one JSON document, for programs."),
    _flag("--quiet", _QUIET, "Show errors alone, and the document if it is asked for."),
)


def with_options(command: click.Command) -> click.Command:
    """Return a command with the options of all."""
    command.params += [each for each in _OPTIONS if each not in command.params]
    return command
