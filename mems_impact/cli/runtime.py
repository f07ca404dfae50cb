"""Exit status, error messages and global options of a command."""

from __future__ import annotations

import _thread
import contextlib
import logging
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from importlib.machinery import ExtensionFileLoader
from types import FrameType
from typing import Any

import click

from mems_impact.errors import Interrupted, InvalidFile, InvalidParameter, MemsImpactError

__all__ = ["as_json", "quiet", "with_options"]

# --- Options that every command has: how it tells what it has found.

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


# --- What a failure becomes: one line on standard error and an exit status.

PROGRAM = "mems-impact"

FAILED, BAD_INPUT = 1, 2
# As a shell counts what a signal ends: 128 and its number, here of SIGINT, SIGPIPE and SIGTERM.
INTERRUPTED, NO_READER, TERMINATED = 130, 141, 143

_IMPORTS = {
    ExtensionFileLoader.create_module.__code__,
    ExtensionFileLoader.exec_module.__code__,
}


class ClickBypass(Exception):
    """Carries an interruption or a failure of the system past click, which has its own answers."""

    def __init__(self, error: BaseException) -> None:
        self.error = error
        super().__init__(str(error))


@contextlib.contextmanager
def past_click() -> Iterator[None]:
    """Turn what click would answer itself into `ClickBypass`."""
    try:
        yield
    except (KeyboardInterrupt, OSError) as error:
        raise ClickBypass(error) from error


@contextlib.contextmanager
def interruptible() -> Iterator[list[signal.Signals]]:
    """Let Ctrl-C and SIGTERM raise KeyboardInterrupt in the block, and neither be lost.

    Gives the list of the signals that have come. A signal that is ignored, or that somebody else
    handles, is left alone.
    """
    heard: list[signal.Signals] = []
    pending: list[threading.Timer] = []
    before = {
        number: signal.getsignal(number)
        for number in (signal.SIGINT, signal.SIGTERM)
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler)
    }

    def interrupt(number: int, frame: FrameType | None) -> None:
        heard.append(signal.Signals(number))
        if _importing(frame):
            later()
        else:
            raise KeyboardInterrupt

    def later() -> None:
        if not pending:
            pending.append(threading.Timer(0.05, again))
            pending[0].start()

    def again() -> None:
        pending.clear()  # first, for this one may be dropped as well
        _thread.interrupt_main(heard[0])

    def dropped(lost: sys.UnraisableHookArgs) -> None:
        # Python drops what is raised in a call from C, as there are many when numba loads compiled
        # code. Not at once: this is such a call itself.
        if heard and issubclass(lost.exc_type, KeyboardInterrupt):
            later()
        else:
            shown(lost)

    if threading.current_thread() is not threading.main_thread():
        yield heard  # signals come to the main thread alone
        return
    shown, sys.unraisablehook = sys.unraisablehook, dropped
    for number in before:
        signal.signal(number, interrupt)
    try:
        yield heard
    finally:
        for timer in list(pending):
            timer.cancel()
        sys.unraisablehook = shown
        for number, handler in before.items():
            signal.signal(number, handler)


def _importing(frame: FrameType | None) -> bool:
    """Return whether an extension module is just being imported.

    Such modules drop what is raised meanwhile, and the work would go on.
    """
    while frame is not None:
        if frame.f_code in _IMPORTS:
            return True
        frame = frame.f_back
    return False


def say(text: str) -> None:
    """Write one line to standard error, if anybody can read it."""
    with contextlib.suppress(OSError):
        click.echo(f"{PROGRAM}: {' '.join(text.split())}", err=True)


def warn(text: str) -> None:
    """Say what the user should know, unless errors alone are wanted."""
    if not quiet():
        say(f"warning: {text}")


def show_warnings_briefly() -> None:
    """Let a warning be one line on standard error, without the place in the code."""

    def show(message: Warning | str, *_rest: object) -> None:
        warn(str(message))

    warnings.showwarning = show  # type: ignore[assignment]


def report(error: BaseException) -> int:
    """Say what went wrong and return the exit status.

    An error that is nobody's input and none of the package's own is a bug: it is raised again, for
    the traceback is what a report of it needs. What an `Output` has noted on it is said too.
    """
    if isinstance(error, ClickBypass):
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
