"""Codes: what the event loop answers, and what its rows are.

Compiled code compares plain integers; the enumerations give them their names.
"""

from __future__ import annotations

from enum import IntEnum

__all__ = ["Kind", "Status"]


class Status(IntEnum):
    """What the event loop answers."""

    PAUSED = 0  # its quota of steps is spent
    BUFFER_FULL = 1
    DONE = 2
    FAILED = 3  # the engine cannot go on
    STEP_BUDGET = 4
    EVENT_BUDGET = 5
    CYCLING = 6  # the same state comes back within an instant
    INADMISSIBLE = 7  # the start lies beyond a guard
    WITHOUT_EFFECT = 8  # an impact changes nothing
    NO_SUCH_MODE = 9
    NOT_FINITE = 10
    ENDED = 11  # by a transition


class Kind(IntEnum):
    """What a row of the event buffer tells."""

    TRANSITION = 0
    ACCUMULATION = 1  # a sequence of impacts has come to its end
    SWITCH = 2  # of the drive
    APPROACH = 3  # closest, of bodies that part without an impact
    SECTION_CROSSING = 4
    REBASE = 5  # nothing: the loop cuts a long arc
    HANDOVER = 6  # the engine goes on by another method; with what it remembers of the mode
