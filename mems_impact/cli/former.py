"""Words of the command line that have changed, and go on working for a release.

The group replaces them before a command reads its arguments, so that no command knows of them.
When the release is over, this file goes, and `resolve_command` of the group with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import takewhile

import click

from mems_impact.cli.runtime import warn

_RANGE = {"--from": "--start {}", "--to": "--stop {}"}
_DRIVE = {"--period": "--drive-period {}"}
_STATE = {f"--{name}": f"--initial {name}={{}}" for name in ("x2", "v2", "v1")}

FORMER: Mapping[str, Mapping[str, str]] = {
    "chart": _RANGE,
    "continue": {"--from": _RANGE["--from"], **_DRIVE, **_STATE},
    "drive": _DRIVE,
    "fit": {**_DRIVE, **_STATE},
    "orbit": {**_DRIVE, **_STATE},
    "simulate": {**_DRIVE, **_STATE},
    "sweep": {**_RANGE, **_DRIVE},
    "validate": {"--figure": "{}"},
}
"""Of each command, the former options, each with one value, and what is written for them now."""


def in_present_words(command: str, arguments: Sequence[str]) -> list[str]:
    """Return the arguments of a command in its present words, and say which have changed."""
    former = FORMER.get(command, {})
    options = list(takewhile(lambda word: word != "--", arguments))
    waiting = iter(options)
    result: list[str] = []
    before: list[str] = []
    now: list[str] = []
    for word in waiting:
        name, equals, value = word.partition("=")
        if name not in former:
            result.append(word)
            continue
        if not equals:
            given = next(waiting, None)
            if given is None:
                raise click.BadOptionUsage(name, f"Option {name!r} requires an argument.")
            value = given
        # Split before the value comes in, which may hold spaces.
        words = [part.format(value) for part in former[name].split()]
        result += words
        before += [name, value]
        now += words
    if before and "--quiet" not in options:
        warn(f"{' '.join(before)} is now written {' '.join(now)}")
    return result + list(arguments[len(options) :])
