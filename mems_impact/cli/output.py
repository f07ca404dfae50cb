"""Where results go: a directory of tables and a figure, checked before the work begins.

All files are written before anything is shown on the screen, whose reader may have gone.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import click

from mems_impact.cli.showing import show, tell_files, tell_tables
from mems_impact.writing import replacing

FIGURES = (".png", ".pdf", ".svg")
MOST_NAMED = 10
REMEDY = "give another place with --output or --figure"


class Output:
    """The files of one command; what ends the command early is told which of them stand.

    Parameters
    ----------
    directory : str
        Where they go; created, and removed again if nothing is written.
    figure : str or None
        Path of the figure; by default `name` with ``.png`` in the directory.
    no_figure : bool
    name : str
        First part of all names.

    Raises
    ------
    click.ClickException
        If a file could not be written there.

    Examples
    --------
    >>> with Output("out", None, False, "sweep") as files:
    ...     files.tables({"table": table})
    ...     files.draw(lambda: plot_sweep(table).figure)
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
        self.written: list[Path] = []
        self._made: list[Path] = []
        # Now, not after minutes of work.
        self._make(self.directory)
        if self.figure is not None:
            self._make(self.figure.parent)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        tell_files(self.written)
        if not self.written:
            self._remove_made()
        elif error is not None:
            error.add_note(self.said())

    def tables(self, tables: Mapping[str, Any]) -> None:
        """Write pandas tables as CSV, by the last part of their names: all of them, or none."""
        from mems_impact.tables.common import with_units  # pandas is slow to import

        tell_tables(tables)
        paths = [self.directory / f"{self.name}-{what}.csv" for what in tables]
        with ExitStack() as stack:
            for path, table in zip(paths, tables.values(), strict=True):
                with_units(table).to_csv(stack.enter_context(replacing(path)), index=False)
        self.written += paths

    def draw(self, draw: Callable[[], Any]) -> None:
        """Write the figure that `draw` makes, if one is wanted."""
        from mems_impact.plotting.style import wearing

        if self.figure is None:
            return
        figure = draw()
        with wearing(), replacing(self.figure) as temporary:
            figure.savefig(temporary)
        self.written.append(self.figure)

    def tell(self) -> None:
        """Show what was written."""
        show(self.said())

    def moving(self, path: str | None) -> None:
        """Check, before the work, that a moving picture can be written there, if one is wanted."""
        if path is not None:
            from mems_impact.plotting.animation import check_ending

            check_ending("animate", path)
            self._make(Path(path).parent)

    def animate(self, path: str | None, make: Callable[[], Any], progress: bool) -> None:
        """Write the moving picture that `make` makes, if one is wanted."""
        if path is not None:
            make().save(path, progress=progress)
            self.written.append(Path(path))

    def said(self) -> str:
        """Return what was written, as a sentence."""
        if not self.written:
            return "nothing was written"
        if len(self.written) > MOST_NAMED:
            return f"written: {len(self.written)} files in {self.directory}"
        return f"written: {', '.join(map(str, self.written))}"

    def _make(self, directory: Path) -> None:
        missing = [place for place in (directory, *directory.parents) if not place.exists()]
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except FileExistsError:
            raise click.ClickException(f"{directory}: is not a directory; {REMEDY}") from None
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise click.ClickException(
                f"{directory}: cannot be made ({reason}); {REMEDY}"
            ) from None
        if not os.access(directory, os.W_OK | os.X_OK):
            raise click.ClickException(f"{directory}: cannot be written to; {REMEDY}")
        self._made += missing

    def _remove_made(self) -> None:
        """Remove the directories that were made here, innermost first, unless they hold files."""
        for place in self._made:
            try:
                place.rmdir()
            except OSError:
                return
