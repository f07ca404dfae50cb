"""Options that give parameters or quantities a lowest and a highest value."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

Pairs = dict[str, tuple[float | None, float | None]]


def ranges(example: str, *, half_open: bool = False) -> Callable[..., Pairs]:
    """Return the callback of an option NAME=LOW:HIGH that may be repeated.

    Parameters
    ----------
    example : str
        For messages.
    half_open : bool, optional
        Whether one of the two may be left out.
    """

    def number(text: str) -> float | None:
        return None if half_open and not text else float(text)

    def read(_ctx: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]) -> Pairs:
        found: Pairs = {}
        for text in texts:
            name, _, limits = (part.strip() for part in text.partition("="))
            low, colon, high = (part.strip() for part in limits.partition(":"))
            try:
                if not name or not colon or not (low or high):
                    raise ValueError
                found[name] = number(low), number(high)
            except ValueError:
                problem = f"{text!r} must be NAME=LOW:HIGH, such as {example}"
                raise click.BadParameter(problem) from None
        return found

    return read


def ranges_option(option: str, example: str, text: str, **settings: Any) -> Callable[[Any], Any]:
    """Return an option NAME=LOW:HIGH that may be repeated; `settings` as of `click.option`."""
    half_open = settings.pop("half_open", False)
    return click.option(
        option,
        multiple=True,
        metavar="NAME=LOW:HIGH",
        callback=ranges(example, half_open=half_open),
        help=f"{text} May be repeated.",
        **settings,
    )
