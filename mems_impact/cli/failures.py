"""What a failure becomes: one line on standard error and an exit status."""

from __future__ import annotations

import os
import sys
import warnings

import click

from mems_impact.errors import InvalidFile, InvalidParameter, MemsImpactError

PROGRAM = "mems-impact"

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130


def say(text: str) -> None:
    """Write one line to standard error."""
    click.echo(f"{PROGRAM}: {' '.join(text.split())}", err=True)


def show_warnings_briefly() -> None:
    """Let a warning be one line on standard error, without the place in the code."""

    def show(message: Warning | str, *_rest: object) -> None:
        say(f"warning: {message}")

    warnings.showwarning = show  # type: ignore[assignment]


def report(error: BaseException) -> int:
    """Say what went wrong and return the exit status.

    An error that is nobody's input and none of the package's own is a bug: it is raised again, for
    the traceback is what a report of it needs.
    """
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        say(f"a command is missing; see {PROGRAM} --help")
        return BAD_INPUT
    if isinstance(error, click.UsageError):
        command = error.ctx.command_path if error.ctx is not None else PROGRAM
        text = error.format_message().rstrip(".")
        say(f"{text[:1].lower()}{text[1:]}; see {command} --help")
        return BAD_INPUT
    if isinstance(error, click.ClickException):
        say(error.format_message())
        return BAD_INPUT
    if isinstance(error, click.Abort | KeyboardInterrupt):
        say("interrupted; nothing was written")
        return INTERRUPTED
    if isinstance(error, BrokenPipeError):
        # The reader of our output has gone; nothing that Python flushes at exit may reach it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    if isinstance(error, InvalidParameter | InvalidFile):
        say(str(error))
        return BAD_INPUT
    if isinstance(error, MemsImpactError):
        say(str(error))
        return FAILED
    raise error
