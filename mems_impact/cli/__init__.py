"""The command line."""

from __future__ import annotations

# Nothing that takes long to import: an interrupt meanwhile would end in a traceback.
import atexit
import gc
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from mems_impact.cli.interrupts import INTERRUPTED, TERMINATED, interruptible

YOUNG_OBJECTS = 50_000  # between two collections; 700 or 2,000 by default


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line, by default with the arguments of the process, and exit.

    Exit statuses: 0, done; 1, the run stopped early, its verdict is unfavourable, or the disk or
    standard output is full; 2, bad input; 130 and 143, interrupted by Ctrl-C or SIGTERM; 141,
    standard output was closed by its reader.
    """
    # Imports create objects that last: collecting the young ones less often, and not scanning all
    # of them at exit, each saves some 0.1 s.
    gc.set_threshold(YOUNG_OBJECTS)
    atexit.register(gc.freeze)
    with interruptible() as signals:
        try:
            from mems_impact.cli.commands import run

            status = run(arguments)
        except KeyboardInterrupt:  # while the commands were imported
            sys.stderr.write("mems-impact: interrupted; nothing was written\n")
            status = INTERRUPTED
    if status == INTERRUPTED:
        # An interrupt within `exec` of a text, as of a dataclass that is being imported, leaves a
        # flag by which "python -m" ends by the signal, whatever its status. The next one clears it.
        exec("")
        if signal.SIGTERM in signals:
            status = TERMINATED
    sys.exit(status if isinstance(status, int) else 0)
