"""Ctrl-C and SIGTERM during a command."""

from __future__ import annotations

import _thread
import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from importlib.machinery import ExtensionFileLoader
from types import FrameType

# Exit statuses: 128 plus the number of the signal, as in a shell.
INTERRUPTED, TERMINATED = 130, 143

_IMPORTS = {ExtensionFileLoader.create_module.__code__, ExtensionFileLoader.exec_module.__code__}


@contextlib.contextmanager
def interruptible() -> Iterator[list[signal.Signals]]:
    """Make Ctrl-C and SIGTERM raise KeyboardInterrupt in the block, and lose neither.

    Yields the list of signals received. A signal that is ignored, or has another handler, is left
    alone.
    """
    received: list[signal.Signals] = []
    pending: list[threading.Timer] = []
    before = {
        number: signal.getsignal(number)
        for number in (signal.SIGINT, signal.SIGTERM)
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler)
    }

    def interrupt(number: int, frame: FrameType | None) -> None:
        received.append(signal.Signals(number))
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
        _thread.interrupt_main(received[0])

    def dropped(unraisable: sys.UnraisableHookArgs) -> None:
        # Python drops exceptions raised in a call from C, such as those by which numba loads
        # compiled code. This is such a call itself, so the signal is repeated later.
        if received and issubclass(unraisable.exc_type, KeyboardInterrupt):
            later()
        else:
            previous(unraisable)

    if threading.current_thread() is not threading.main_thread():
        yield received  # only the main thread receives signals
        return
    previous, sys.unraisablehook = sys.unraisablehook, dropped
    for number in before:
        signal.signal(number, interrupt)
    try:
        yield received
    finally:
        for timer in list(pending):
            timer.cancel()
        sys.unraisablehook = previous
        for number, handler in before.items():
            signal.signal(number, handler)


def _importing(frame: FrameType | None) -> bool:
    """Return whether an extension module is being imported.

    Such an import drops exceptions raised meanwhile, and the work would continue.
    """
    while frame is not None:
        if frame.f_code in _IMPORTS:
            return True
        frame = frame.f_back
    return False
