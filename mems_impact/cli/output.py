"""Where results go: a directory of tables and a figure, checked before the work begins."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

FIGURES = (".png", ".pdf", ".svg")
REMEDY = "give another place with --output or --figure"


class Output:
    """The files of one command.

    Parameters
    ----------
    directory : str
        Where they go; created.
    figure : str or None
        Path of the figure; by default `name` with ``.png`` in the directory.
    no_figure : bool
    name : str
        First part of all names.

    Raises
    ------
    click.ClickException
        If a file could not be written there.
    """

    def __init__(self, directory: str, figure: str | None, no_figure: bool, name: str) -> None:
        if no_figure and figure is not None:
            raise click.UsageError("--figure and --no-figure exclude each other; leave one out")
        self.name = name
        self.directory = Path(directory)
        self.figure: Path | None = None
        if not no_figure:
            self.figure = Path(figure) if figure else self.directory / f"{name}.png"
            if self.figure.suffix.lower() not in FIGURES:
                allowed = f"{', '.join(FIGURES[:-1])} or {FIGURES[-1]}"
                raise click.UsageError(f"--figure {self.figure}: the name must end in {allowed}")
        # Now, not after minutes of work.
        _make(self.directory)
        if self.figure is not None:
            _make(self.figure.parent)
        self.written: list[Path] = []

    def table(self, what: str, table: Any) -> None:
        """Write a pandas table as CSV."""
        path = self.directory / f"{self.name}-{what}.csv"
        self._write(path, lambda: table.to_csv(path, index=False))

    def draw(self, draw: Callable[[], Any]) -> None:
        """Write the figure that `draw` makes, if one is wanted."""
        if self.figure is None:
            return
        path = self.figure
        figure = draw()
        self._write(path, lambda: figure.savefig(path, dpi=150))

    def said(self) -> str:
        """Return what was written, as a sentence."""
        return f"written: {', '.join(map(str, self.written))}"

    def _write(self, path: Path, write: Callable[[], Any]) -> None:
        try:
            write()
        except OSError as error:
            raise _unwritable(path, error) from None
        self.written.append(path)


def _make(directory: Path) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise click.ClickException(f"{directory}: is not a directory; {REMEDY}") from None
    except OSError as error:
        raise _unwritable(directory, error) from None
    if not os.access(directory, os.W_OK | os.X_OK):
        raise click.ClickException(f"{directory}: cannot be written to; {REMEDY}")


def _unwritable(path: Path, error: OSError) -> click.ClickException:
    reason = (error.strerror or str(error)).lower()
    return click.ClickException(f"{path}: cannot be written ({reason}); {REMEDY}")
