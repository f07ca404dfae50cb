"""Output of a command: text, one JSON document, files and figures.

Commands show everything through this module. With ``--json`` the results are collected and printed
as one document at the end: ``values`` and ``units`` by name, ``tables`` (each with ``units`` by
column and ``rows``, whose keys are the columns), and the ``files`` written. Numbers that are
missing or infinite become null.

All files are written before anything is shown on the screen, whose reader may have gone.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import textwrap
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import click

from mems_impact._util.files import replacing
from mems_impact.cli.runtime import as_json, quiet

if TYPE_CHECKING:
    import pandas as pd

# --- Text and JSON output

_KEY = "mems_impact.document"
ENTRY = re.compile(r"[\w ]{1,40}: ")  # of a list of names or topics
DOCSTRING_WIDTH = 92  # columns of the narrowest docstrings, those of methods
MIN_TEXT_WIDTH = 20  # columns of a wrapped text beside a wide first column


class OutputValue(NamedTuple):
    """A value that a command shows on one line: a number, a text, or a list of these."""

    value: Any
    unit: str = ""  # empty for a pure number
    text: str | None = None  # shown in place of the value


@dataclass
class JsonDocument:
    """Results of a command, for programs."""

    values: dict[str, Any] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    tables: dict[str, Any] = field(default_factory=dict)
    files: list[str] = field(default_factory=list)


def _document() -> JsonDocument:
    return click.get_current_context().meta.setdefault(_KEY, JsonDocument())


def unit_of(table: pd.DataFrame, name: str) -> str:
    """Return the unit of a column after a space; an empty text if it has no unit."""
    unit = table.attrs.get("units", {}).get(name, "")
    return f" {unit}" if unit else ""


def with_units_in(table: pd.DataFrame, column: str, units: Mapping[str, str]) -> pd.DataFrame:
    """Return a table whose names in `column` carry their units: ``omega [rad/s]``."""
    names = [f"{name} [{units[name]}]" if units.get(name) else name for name in table[column]]
    return table.assign(**{column: names})


def with_unit_column(table: pd.DataFrame, column: str, units: Mapping[str, str]) -> pd.DataFrame:
    """Return a table for files and programs, with the unit of the quantity that each row names.

    A table without units is returned unchanged.
    """
    if not units:
        return table
    return table.assign(unit=[units.get(name, "") for name in table[column]])


def show(text: str) -> None:
    """Show a text that adds nothing to values and tables."""
    if not as_json() and not quiet():
        click.echo(text)


def filled(text: str) -> str:
    """Return a text in lines as wide as the terminal, all but the first indented."""
    width = shutil.get_terminal_size().columns
    wrapper = textwrap.TextWrapper(
        width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    return wrapper.fill(text)


def show_text(text: str) -> None:
    """Show a long text, page by page on a terminal."""
    add_json_values({"text": OutputValue(text)})
    if not as_json() and not quiet():
        click.echo_via_pager(reflowed(text, shutil.get_terminal_size().columns))


def reflowed(text: str, width: int) -> str:
    """Return a text whose paragraphs are at most `width` wide, with code unchanged.

    A line that was filled continues in the next line of the same indent.
    """
    paragraphs: list[list[str]] = []
    for line in text.splitlines():
        if paragraphs and _continues(paragraphs[-1], line):
            paragraphs[-1].append(line)
        else:
            paragraphs.append([line])
    return "\n".join(line for lines in paragraphs for line in _refilled(lines, width))


def _continues(paragraph: list[str], line: str) -> bool:
    """Return whether a line belongs to a paragraph."""
    word = line.split(maxsplit=1)[:1]
    if not word or not paragraph[-1].strip() or _is_code(paragraph[0]) or _is_code(line):
        return False
    if ENTRY.match(line):
        return False
    full = len(paragraph[-1]) + 1 + len(word[0]) > DOCSTRING_WIDTH
    return full and _indent(line) == _hanging_indent(paragraph)


def _refilled(paragraph: list[str], width: int) -> list[str]:
    is_reference = len(paragraph) == 1 and len(paragraph[0].split()) <= 2  # an address and its name
    if is_reference or _is_code(paragraph[0]) or max(map(len, paragraph)) <= width:
        return paragraph
    return textwrap.wrap(
        " ".join(line.strip() for line in paragraph),
        width,
        initial_indent=" " * _indent(paragraph[0]),
        subsequent_indent=" " * _hanging_indent(paragraph),
        break_long_words=False,
        break_on_hyphens=False,
    )


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def _hanging_indent(paragraph: list[str]) -> int:
    """Return the indent of all lines but the first."""
    item = paragraph[0].lstrip().startswith("- ")
    return _indent(paragraph[0]) + 2 * item


def _is_code(line: str) -> bool:
    return line.lstrip().startswith((">>>", "..."))


def show_table(name: str, table: pd.DataFrame, *, digits: int, empty_message: str = "") -> None:
    """Show a table, units in its headings, as wide as the terminal; `empty` if it has no rows."""
    if as_json():
        add_json_tables({name: table})
        return
    from mems_impact.tables import with_units

    form = f"{{:.{digits}g}}".format
    width = shutil.get_terminal_size().columns  # 80 where there is no terminal
    text = folded(with_units(table), form, width) if len(table) else empty_message
    if text:
        show(text + "\n")


def folded(table: pd.DataFrame, form: Callable[[float], str], width: int) -> str:
    """Return a table as text that is at most `width` wide, where single columns allow it.

    Headings of a wider table are wrapped. Columns that do not fit follow in blocks below, each of
    which begins with the first column; texts that do not fit beside it are wrapped.
    """
    text: str = table.to_string(index=False, float_format=form)
    if max(map(len, text.splitlines())) <= width:
        return text
    columns = [_wrapped(table.iloc[:, [i]], form) for i in range(table.shape[1])]
    height = max(map(len, columns))
    columns = [[" " * len(lines[0])] * (height - len(lines)) + lines for lines in columns]
    columns = _with_wrapped_texts(columns, width)
    blocks = [columns[:1]]
    for lines in columns[1:]:
        block_width = sum(len(each[0]) + 1 for each in blocks[-1]) + len(lines[0])
        if block_width > width and len(blocks[-1]) > 1:
            blocks.append(columns[:1])
        blocks[-1].append(lines)
    rows = ([" ".join(row) for row in zip(*block, strict=True)] for block in blocks)
    return "\n\n".join("\n".join(row for row in block if row.strip()) for block in rows)


def _with_wrapped_texts(columns: list[list[str]], width: int) -> list[list[str]]:
    """Return columns whose texts are wrapped where they do not fit beside the first column."""
    room = max(width - len(columns[0][0]) - 1, MIN_TEXT_WIDTH)
    if all(len(lines[0]) <= room for lines in columns[1:]):
        return columns

    def wrapped_lines(cell: str) -> list[str]:
        if len(cell) <= room:
            return [cell]
        return textwrap.wrap(cell.strip(), room, break_long_words=False) or [""]

    cells = [
        [[line] for line in columns[0]],
        *([wrapped_lines(line) for line in c] for c in columns[1:]),
    ]
    heights = [max(map(len, row)) for row in zip(*cells, strict=True)]
    result = []
    for column in cells:
        lines = [
            line
            for each, height in zip(column, heights, strict=True)
            for line in each + [""] * (height - len(each))
        ]
        result.append([line.ljust(max(map(len, lines))) for line in lines])
    return result


def _wrapped(column: pd.DataFrame, form: Callable[[float], str]) -> list[str]:
    """Return heading and cells of a table of one column, the heading as narrow as its words."""
    cells = column.to_string(index=False, header=False, float_format=form).splitlines()
    cells = [cell.strip() for cell in cells]
    heading = str(column.columns[0])
    width = max(map(len, [*cells, *heading.split()]))
    return [line.rjust(width) for line in [*textwrap.wrap(heading, width), *cells]]


def show_values(values: Mapping[str, OutputValue], *, in_units: bool = True) -> None:
    """Show one line per value, its name and unit before it.

    Units are omitted if all values are pure numbers (`in_units` is False).
    """
    if not in_units:
        values = {name: value._replace(unit="") for name, value in values.items()}
    add_json_values(values)
    headings = [f"{name} [{value.unit}]" if value.unit else name for name, value in values.items()]
    width = max(map(len, headings))
    for heading, value in zip(headings, values.values(), strict=True):
        text = value.text
        if text is None:
            text = f"{value.value:.9g}" if isinstance(value.value, float) else str(value.value)
        show(f"  {heading:<{width}}  {text}")


def add_json_values(values: Mapping[str, OutputValue]) -> None:
    """Add values to the JSON document."""
    if as_json():
        _document().values |= {name: value.value for name, value in values.items()}
        _document().units |= {name: value.unit for name, value in values.items() if value.unit}


def add_json_tables(tables: Mapping[str, pd.DataFrame]) -> None:
    """Add tables to the JSON document; a table already there stays."""
    if as_json():
        for name, table in tables.items():
            _document().tables.setdefault(name, table)


def add_json_files(files: Iterable[object]) -> None:
    """Add the names of written files to the JSON document."""
    if as_json():
        _document().files += map(str, files)


def finish(ctx: click.Context) -> None:
    """Print the JSON document of a finished command, if it was asked for."""
    if not as_json():
        return
    collected: JsonDocument | None = ctx.meta.get(_KEY)
    if collected is not None:
        tables = {name: _of_table(table) for name, table in collected.tables.items()}
        document = {"command": ctx.invoked_subcommand, **vars(collected), "tables": tables}
        click.echo(json.dumps(_json_value(document), ensure_ascii=False, allow_nan=False))


def _of_table(table: pd.DataFrame) -> dict[str, Any]:
    names = [str(name) for name in table.columns]
    columns = [table[name].tolist() for name in table.columns]
    rows = [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
    return {"units": table.attrs.get("units", {}), "rows": rows}


def _json_value(value: Any) -> Any:
    """Return a value in types of JSON."""
    match value:
        case None | bool() | int():
            return value
        case str():
            return str(value)
        case float():
            return value if math.isfinite(value) else None
        case complex():
            return {"re": _json_value(value.real), "im": _json_value(value.imag)}
        case Mapping():
            return {str(name): _json_value(each) for name, each in value.items()}
        case list() | tuple():
            return [_json_value(each) for each in value]
    if hasattr(value, "tolist"):  # of NumPy
        return _json_value(value.tolist())
    return str(value)


# --- Output files

DIRECTORY, STANDARD_OUTPUT = "out", "-"
FIGURE_SUFFIXES = (".png", ".pdf", ".svg")
OUTPUT_REMEDY = "choose another place with --output or --figure"


class Output:
    """The files of one command; an exception that ends it early notes which files were written.

    The directory is created, and removed again if nothing is written; ``-``, and by default with
    ``--json``, is none, so that tables are shown only; otherwise `DIRECTORY` by default. The figure
    is by default `name` with ``.png`` there; all names begin with `name`. Raises
    click.ClickException if a file could not be written.

    >>> with Output("out", None, False, "sweep") as files:
    ...     files.tables({"table": table})
    ...     files.draw(lambda: plot_sweep(table).figure)
    """

    def __init__(
        self, directory: str | None, figure: str | None, no_figure: bool, name: str
    ) -> None:
        if no_figure and figure is not None:
            raise click.UsageError("--figure and --no-figure exclude each other; leave one out")
        self.name = name
        if directory is None:
            directory = STANDARD_OUTPUT if as_json() else DIRECTORY
        self.directory = None if directory == STANDARD_OUTPUT else Path(directory)
        self.figure: Path | None = None
        if figure or (self.directory and not no_figure):
            self.figure = Path(figure) if figure else Path(directory) / f"{name}.png"
            if self.figure.suffix.lower() not in FIGURE_SUFFIXES:
                allowed = f"{', '.join(FIGURE_SUFFIXES[:-1])} or {FIGURE_SUFFIXES[-1]}"
                raise click.UsageError(f"--figure {self.figure}: the name must end in {allowed}")
        self.written: list[Path] = []
        self._created_folders: list[Path] = []
        # Now, not after minutes of work.
        if self.directory is not None:
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
        add_json_files(self.written)
        if not self.written:
            self._remove_created_folders()
        elif error is not None:
            error.add_note(self.description())

    def tables(self, tables: Mapping[str, Any]) -> None:
        """Write pandas tables as CSV, by the last part of their names: all of them, or none."""
        from mems_impact.tables import with_units  # pandas is slow to import

        add_json_tables(tables)
        if self.directory is None:
            return
        paths = [self.directory / f"{self.name}-{label}.csv" for label in tables]
        with ExitStack() as stack:
            for path, table in zip(paths, tables.values(), strict=True):
                with_units(table).to_csv(stack.enter_context(replacing(path)), index=False)
        self.written += paths

    def draw(self, draw: Callable[[], Any]) -> None:
        """Write the figure that `draw` returns, unless none is wanted."""
        from mems_impact.plotting.style import wearing

        if self.figure is None:
            return
        figure = draw()
        with wearing(), replacing(self.figure) as temporary:
            figure.savefig(temporary)
        self.written.append(self.figure)

    def show(self) -> None:
        """Show which files were written, if any, in lines as wide as the terminal."""
        if self.written:
            show(filled(self.description()))

    def moving(self, path: str | None) -> None:
        """Check, before the work, that an animation can be written to `path`, if one is wanted."""
        if path is not None:
            from mems_impact.plotting.animation import check_ending

            check_ending("animate", path)
            self._make(Path(path).parent)

    def animate(self, path: str | None, make: Callable[[], Any], progress: bool) -> None:
        """Write the animation that `make` returns, if one is wanted."""
        if path is not None:
            make().save(path, progress=progress)
            self.written.append(Path(path))

    def description(self) -> str:
        """Return a sentence that names the written files."""
        if not self.written:
            return "nothing was written"
        return f"written: {', '.join(map(str, self.written))}"

    def _make(self, directory: Path) -> None:
        missing = [folder for folder in (directory, *directory.parents) if not folder.exists()]
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except FileExistsError:
            raise click.ClickException(f"{directory}: not a directory; {OUTPUT_REMEDY}") from None
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise click.ClickException(
                f"{directory}: cannot be created ({reason}); {OUTPUT_REMEDY}"
            ) from None
        if not os.access(directory, os.W_OK | os.X_OK):
            raise click.ClickException(f"{directory}: not writable; {OUTPUT_REMEDY}")
        self._created_folders += missing

    def _remove_created_folders(self) -> None:
        """Remove the directories created here, innermost first, unless they hold files."""
        for folder in self._created_folders:
            try:
                folder.rmdir()
            except OSError:
                return
