"""What a failure becomes: one line on standard error and an exit status."""

from __future__ import annotations

import _thread
import contextlib
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from types import FrameType

import click

from mems_impact.errors import Interrupted, InvalidFile, InvalidParameter, MemsImpactError

PROGRAM = "mems-impact"

FAILED, BAD_INPUT = 1, 2
# As a shell counts what a signal ends: 128 and its number, here of SIGINT, SIGPIPE and SIGTERM.
INTERRUPTED, NO_READER, TERMINATED = 130, 141, 143


class PastClick(Exception):
    """Carries an interruption or a failure of the system past click, which has its own answers."""

    def __init__(self, error: BaseException) -> None:
        self.error = error
        super().__init__(str(error))


@contextlib.contextmanager
def past_click() -> Iterator[None]:
    """Turn what click would answer itself into `PastClick`."""
    try:
        yield
    except (KeyboardInterrupt, OSError) as error:
        raise PastClick(error) from error


@contextlib.contextmanager
def terminable() -> Iterator[list[int]]:
    """Let SIGTERM interrupt the block as Ctrl-C does, and neither be lost.

    Gives a list that is not empty once SIGTERM has come.
    """
    heard: list[int] = []

    def interrupt(number: int, _frame: FrameType | None) -> None:
        heard.append(number)
        raise KeyboardInterrupt

    here = threading.current_thread() is threading.main_thread()
    if not here or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield heard  # whoever calls hears it, or has it ignored
        return
    signal.signal(signal.SIGTERM, interrupt)
    shown = sys.unraisablehook
    pending: list[threading.Timer] = []

    def raise_again() -> None:
        pending.clear()  # first, for this one may be dropped as well
        _thread.interrupt_main(signal.SIGTERM if heard else signal.SIGINT)

    def once_more(lost: sys.UnraisableHookArgs) -> None:
        # Python drops what is raised in a call from C, as there are many when numba loads compiled
        # code; the work would go on. Not at once: this is such a call itself.
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            shown(lost)
        elif not pending:
            pending.append(threading.Timer(0.05, raise_again))
            pending[0].start()

    sys.unraisablehook = once_more
    try:
        yield heard
    finally:
        for timer in list(pending):
            timer.cancel()
        sys.unraisablehook = shown
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def say(text: str) -> None:
    """Write one line to standard error, if anybody can read it."""
    with contextlib.suppress(OSError):
        click.echo(f"{PROGRAM}: {' '.join(text.split())}", err=True)


def show_warnings_briefly() -> None:
    """Let a warning be one line on standard error, without the place in the code."""

    def show(message: Warning | str, *_rest: object) -> None:
        say(f"warning: {message}")

    warnings.showwarning = show  # type: ignore[assignment]


def report(error: BaseException) -> int:
    """Say what went wrong and return the exit status.

    An error that is nobody's input and none of the package's own is a bug: it is raised again, for
    the traceback is what a report of it needs. What an `Output` has noted on it is said too.
    """
    if isinstance(error, PastClick):
        return report(error.error)
    written = "; ".join(getattr(error, "__notes__", ()))
    more = f"; {written}" if written else ""
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        say(f"a command is missing; see {PROGRAM} --help")
        return BAD_INPUT
    if isinstance(error, click.UsageError):
        command = error.ctx.command_path if error.ctx is not None else PROGRAM
        text = error.format_message().rstrip(".")
        say(f"{text[:1].lower()}{text[1:]}; see {command} --help")
        return BAD_INPUT
    if isinstance(error, click.ClickException):
        say(error.format_message() + more)
        return BAD_INPUT
    if isinstance(error, click.Abort | KeyboardInterrupt):
        after = f" after {error.after}" if isinstance(error, Interrupted) else ""
        say(f"interrupted{after}; {written or 'nothing was written'}")
        return INTERRUPTED
    if isinstance(error, OSError):
        refusal = _refusal_of_the_screen()
        if isinstance(refusal, BrokenPipeError):
            return NO_READER
        if refusal is not None:
            say(f"standard output cannot be written ({(refusal.strerror or '').lower()}){more}")
            return FAILED
    if isinstance(error, InvalidParameter | InvalidFile):
        say(f"{error}{more}")
        return BAD_INPUT
    if isinstance(error, MemsImpactError):
        say(f"{error}{more}")
        return FAILED
    raise error


def _refusal_of_the_screen() -> OSError | None:
    """Return why standard output takes nothing more; None if it takes the end of a line.

    What it has refused may wait in its buffer, and is dropped here, for Python would try again
    when it exits.
    """
    try:
        click.echo("")
    except OSError as refusal:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return refusal
    return None
