"""Exit status, error messages and global options of a command."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import click

from mems_impact.cli.interrupts import INTERRUPTED
from mems_impact.errors import Interrupted, InvalidFile, InvalidParameter, MemsImpactError

# --- Options of every command

_JSON, _QUIET = "mems_impact.json", "mems_impact.quiet"
# In the context of click:
STORE = "mems_impact.store"  # of the running study
FROM_FILE = "mems_impact.from_file"  # a file holds the arguments of the study


def as_json() -> bool:
    """Return whether the running command prints its results as one JSON document."""
    return _is_set(_JSON)


def quiet() -> bool:
    """Return whether the running command prints errors only."""
    return _is_set(_QUIET)


def _is_set(key: str) -> bool:
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(key))


def _note(key: str) -> Callable[[click.Context, click.Parameter, bool], None]:
    def note(ctx: click.Context, _parameter: click.Parameter, requested: bool) -> None:
        ctx.meta[key] = requested
        if requested and key == _QUIET:
            _mute(ctx)

    return note


def _mute(ctx: click.Context) -> None:
    """Suppress the package's log while the command runs."""
    log, nobody = logging.getLogger("mems_impact"), logging.NullHandler()
    before = log.propagate
    log.addHandler(nobody)
    log.propagate = False

    def unmute() -> None:
        log.removeHandler(nobody)
        log.propagate = before

    ctx.call_on_close(unmute)


def _flag(name: str, key: str, text: str) -> click.Option:
    # Eager, since defaults of other options depend on it.
    flags: dict[str, Any] = {"is_flag": True, "is_eager": True, "expose_value": False}
    return click.Option([name], callback=_note(key), help=text, **flags)


_OPTIONS = (
    _flag("--json", _JSON, "Print all results as one JSON document, for programs."),
    _flag("--quiet", _QUIET, "Print only errors, and the JSON document if requested."),
)


def with_options(command: click.Command) -> click.Command:
    """Return a command with the options that every command has."""
    command.params += [each for each in _OPTIONS if each not in command.params]
    return command


DRIVE_PREFIX = "drive_"  # of drive options, apart from the command's own options

# --- Failures

PROGRAM = "mems-impact"

FAILED, BAD_INPUT = 1, 2
NO_READER = 141  # 128 plus the number of SIGPIPE


class ClickBypass(Exception):
    """Carries an interruption or an OSError past click, which would handle it itself."""

    def __init__(self, error: BaseException) -> None:
        self.error = error
        super().__init__(str(error))


@contextlib.contextmanager
def past_click() -> Iterator[None]:
    """Turn exceptions that click would handle itself into `ClickBypass`."""
    try:
        yield
    except (KeyboardInterrupt, OSError) as error:
        raise ClickBypass(error) from error


def write_message(text: str) -> None:
    """Write one line to standard error, unless it is closed."""
    with contextlib.suppress(OSError):
        click.echo(f"{PROGRAM}: {' '.join(text.split())}", err=True)


def warn(text: str) -> None:
    """Print a warning, unless only errors are wanted."""
    if not quiet():
        write_message(f"warning: {text}")


def show_warnings_briefly() -> None:
    """Print warnings as one line on standard error, without the place in the code."""

    def show(message: Warning | str, *_rest: object) -> None:
        warn(str(message))

    warnings.showwarning = show  # type: ignore[assignment]


def report_error(error: BaseException) -> int:
    """Print the error message and return the exit status.

    An error that is neither bad input nor the package's own is a bug; it is raised again, since a
    bug report needs its traceback. Notes that an `Output` has added are printed too.
    """
    if isinstance(error, ClickBypass):
        return report_error(error.error)
    # From __set_name__ of a class that is being imported: Python 3.11 wraps it, 3.12 adds a note.
    if isinstance(error, RuntimeError) and isinstance(error.__cause__, KeyboardInterrupt):
        return report_error(error.__cause__)
    notes = getattr(error, "__notes__", ())
    written = "; ".join(note for note in notes if "__set_name__" not in note)
    more = f"; {written}" if written else ""
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        click.echo(error.format_message())
        return 0
    if isinstance(error, click.UsageError):
        command = error.ctx.command_path if error.ctx is not None else PROGRAM
        text = error.format_message().rstrip(".")
        write_message(f"{text[:1].lower()}{text[1:]}; see {command} --help")
        return BAD_INPUT
    if isinstance(error, click.ClickException):
        write_message(error.format_message() + more)
        return BAD_INPUT
    if isinstance(error, click.Abort | KeyboardInterrupt):
        after = f" after {error.after}" if isinstance(error, Interrupted) else ""
        write_message(f"interrupted{after}; {written or 'nothing was written'}")
        return INTERRUPTED
    if isinstance(error, OSError):
        refusal = _refusal_of_the_screen()
        if isinstance(refusal, BrokenPipeError):
            return NO_READER
        if refusal is not None:
            write_message(
                f"cannot write standard output ({(refusal.strerror or '').lower()}){more}"
            )
            return FAILED
    if isinstance(error, InvalidParameter | InvalidFile):
        write_message(f"{error}{more}")
        return BAD_INPUT
    if isinstance(error, MemsImpactError):
        write_message(f"{error}{more}")
        return FAILED
    raise error


def _refusal_of_the_screen() -> OSError | None:
    """Return the error that standard output raises on a write; None if it accepts the write.

    Refused output may remain in its buffer; it is dropped here, since Python would write it again
    at exit.
    """
    try:
        click.echo("")
    except OSError as refusal:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return refusal
    return None
