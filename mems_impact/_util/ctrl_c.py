"""Deferral of Ctrl-C."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def deferring_ctrl_c() -> Iterator[None]:
    """Let Ctrl-C interrupt after the block only, which has to be short.

    Within `concurrent.futures`, for instance, it could leave a lock acquired, for which a worker
    would wait forever, or become a RuntimeError.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    received: list[tuple[int, FrameType | None]] = []
    try:
        signal.signal(signal.SIGINT, lambda *arguments: received.append(arguments))
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if received:
            before(*received[0])
