"""The page of a report: paragraphs, figures and tables as one file of HTML."""

from __future__ import annotations

import base64
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from importlib.metadata import version
from importlib.resources import files
from io import BytesIO
from string import Template
from typing import TYPE_CHECKING, Any, NamedTuple

from mems_impact._util.files import replacing
from mems_impact._util.formatting import escape
from mems_impact._util.units import si_prefixed
from mems_impact.systems.result import SummaryRepr
from mems_impact.tables import unit_of

if TYPE_CHECKING:
    import pandas as pd

# --- Contents of a section


class Picture(NamedTuple):
    """A figure as a data address, its caption, and a text in its place."""

    address: str
    caption: str


class Listing(NamedTuple):
    """A table of texts; numeric columns are aligned to the right."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[bool, ...]
    caption: str = ""


Block = str | Picture | Listing
"""A paragraph, a figure or a table."""


@dataclass(frozen=True, repr=False)
class ReportSection(SummaryRepr):
    """A section of a report."""

    blocks: Sequence[Block] = field(default=(), repr=False)  # paragraphs, figures and tables
    # The main results, for the head of the page.
    facts: Mapping[str, str] = field(default_factory=dict, repr=False)
    notes: Sequence[str] = field(default=(), repr=False)  # warnings of the computation
    problem: str = ""  # why the section could not be computed; empty if it could
    title: str = ""


@dataclass(frozen=True, kw_only=True, repr=False)
class DeviceReport(SummaryRepr):
    """A report on a device, as a page of HTML that contains its figures.

    Attributes
    ----------
    title : str
    description : str
    sections : tuple of ReportSection
    missing : tuple of str
        Titles of the sections that an interruption omitted; empty for a complete report.
    command : str
        The command or call that makes the report.
    provenance : str
        Date and versions.

    See Also
    --------
    report

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> page = mi.report(mita, mi.Sine(amplitude=100, frequency=1), only=["Device", "Energy"])
    >>> page.save("mita.html")
    >>> [section.title for section in page.sections]
    ['Device', 'Energy']
    """

    title: str
    description: str = ""
    sections: tuple[ReportSection, ...] = ()
    missing: tuple[str, ...] = ()
    command: str = ""
    provenance: str = ""

    @property
    def facts(self) -> dict[str, str]:
        """The main results of all sections, by name."""
        return {name: text for section in self.sections for name, text in section.facts.items()}

    def summary(self) -> dict[str, Any]:
        """Return the main results, and the sections that could not be computed."""
        problems = {each.title: each.problem for each in self.sections if each.problem}
        return {"title": self.title, **self.facts, **problems}

    @cached_property
    def html(self) -> str:
        """The page."""
        return _html(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save the page as one file.

        Parameters
        ----------
        path : str or os.PathLike
            An existing file is replaced once the new one is complete.

        Raises
        ------
        InvalidFile
            If `path` cannot be a file.
        FileNotWritten
            If the file cannot be written, for example because the disk is full.
        """
        with replacing(path) as temporary:
            temporary.write_text(self.html, encoding="utf-8")


# --- Numbers as text

DIGITS = 4
LEAST_SIZE = 1e-15  # of a number with a prefix: smaller prefixes are little known


def amount(value: float, unit: str = "") -> str:
    """Return a number with four digits and its unit with a prefix: "20.1 nm".

    >>> amount(2.013e-8, "m"), amount(31.567, "V"), amount(3.2e-6, "kg"), amount(2e-8, "m^2")
    ('20.13 nm', '31.57 V', '3.2 mg', '0.02 mm²')
    """
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "unlimited" if value > 0.0 else "−∞"
    power, size = 0, abs(float(f"{value:.{DIGITS}g}"))
    if unit == "m^2" and 0.0 < size < 1e-4:
        value, unit = (1e12 * value, "µm^2") if size < 1e-9 else (1e6 * value, "mm^2")
    least, most = {"kg": (1e-3, math.inf), "s": (1.0, math.inf)}.get(unit, (1.0, 1e3))
    if LEAST_SIZE <= size < least or size >= most:
        power, unit = si_prefixed(unit, size)
    number = f"{value / 10.0**power:.{DIGITS}g}".replace("e+0", "e").replace("e-0", "e-")
    text = f"{number} {unit}".rstrip()
    return text.replace("^2", "²").replace("^3", "³")


def duration(seconds: float) -> str:
    """Return a long time in hours, days or years."""
    for size, name in ((31557600.0, "years"), (86400.0, "days"), (3600.0, "h")):
        if size <= seconds < math.inf:
            return f"{seconds / size:.{DIGITS}g} {name}"
    return amount(seconds, "s")


def percent(share: float) -> str:
    """Return a share in per cent."""
    return "–" if math.isnan(share) else f"{100.0 * share:.3g} %"


# --- Figures

FIGURE_STYLE = {
    "figure.figsize": (6.0, 2.9), "font.size": 9.5, "svg.fonttype": "path",
    "svg.hashsalt": "mems_impact",
}  # fmt: skip
MAX_SVG_BYTES = 300_000  # above, a figure becomes a PNG
PNG_DPI = 170


def picture(draw: Callable[[], Any], caption: str) -> Picture:
    """Return the figure that `draw` makes, as SVG or, if that is large, as PNG."""
    from mems_impact.plotting.style import style

    with style(FIGURE_STYLE):
        figure = draw()
        content = BytesIO()
        figure.savefig(content, format="svg", metadata={"Date": None})
        kind = "svg+xml"
        if content.tell() > MAX_SVG_BYTES:
            content, kind = BytesIO(), "png"
            figure.savefig(content, format="png", dpi=PNG_DPI, metadata={"Software": None})
    data = base64.b64encode(content.getvalue()).decode("ascii")
    return Picture(f"data:image/{kind};base64,{data}", caption)


# --- Tables


def listing(
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
    numeric: Sequence[int] = (),
    caption: str = "",
) -> Listing:
    """Return a table; `numeric` are the columns of numbers."""
    return Listing(
        tuple(headings),
        tuple(map(tuple, rows)),
        tuple(i in numeric for i in range(len(headings))),
        caption,
    )


def table_listing(table: pd.DataFrame, columns: Mapping[str, str], caption: str = "") -> Listing:
    """Return a table of columns of a result, by their headings."""
    from pandas.api.types import is_numeric_dtype

    units, kinds = table.attrs.get("units", {}), {"share": percent, "life": duration}

    def texts(name: str) -> list[str]:
        if not is_numeric_dtype(table[name]):
            return [str(value).replace("_", " ") for value in table[name]]
        as_text = kinds.get(name, partial(amount, unit=unit_of(name, units)))
        return [as_text(float(value)) for value in table[name]]

    numeric = [i for i, name in enumerate(columns.values()) if is_numeric_dtype(table[name])]
    rows = zip(*map(texts, columns.values()), strict=True)
    return listing(tuple(columns), list(rows), numeric, caption)


def values(rows: Mapping[str, str], caption: str = "") -> Listing:
    """Return a table of names and values."""
    return listing(("quantity", "value"), list(rows.items()), (1,), caption)


# --- HTML


def _html(page: DeviceReport) -> str:
    template = Template((files("mems_impact.actuator") / "report_page.html").read_text("utf-8"))
    slugs = {each.title: f"section-{i}" for i, each in enumerate(page.sections, start=1)}
    lead = f'<p class="lead">{escape(page.description)}</p>' if page.description else ""
    if page.missing:
        left = escape(", ".join(page.missing))
        lead += f'<p class="problem">The report was interrupted. Missing: {left}.</p>'
    facts = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(text)}</dd></div>"
        for name, text in page.facts.items()
    )
    footer = f"<p>{escape(page.provenance)}</p>"
    if page.command:
        footer += f"<pre>{escape(page.command)}</pre>"
    return template.substitute(
        title=escape(page.title),
        generator=escape(f"mems-impact {version('mems-impact')}"),
        lead=lead,
        glance=f"<dl>{facts}</dl>" if facts else "",
        contents="".join(
            f'<li><a href="#{slug}">{escape(title)}</a></li>' for title, slug in slugs.items()
        ),
        sections="\n".join(_section(each, slugs[each.title]) for each in page.sections),
        made=footer,
    )


def _section(section: ReportSection, slug: str) -> str:
    lines = [f'<section id="{slug}">', f"<h2>{escape(section.title)}</h2>"]
    if section.problem:
        lines.append(f'<p class="problem">{escape(section.problem)}</p>')
    lines += map(_block, section.blocks)
    if section.notes:
        notes = "".join(f"<li>{escape(note)}</li>" for note in section.notes)
        lines.append(f'<ul class="notes">{notes}</ul>')
    return "\n".join([*lines, "</section>"])


def _block(block: Block) -> str:
    if isinstance(block, str):
        return f"<p>{escape(block).replace(' %', '&nbsp;%')}</p>"
    if isinstance(block, Picture):
        text = escape(block.caption)
        return (
            f'<figure><div><img src="{block.address}" alt="{text}"></div>'
            f"<figcaption>{text}</figcaption></figure>"
        )
    sides = [' class="number"' if number else "" for number in block.numeric]
    head = "".join(
        f'<th scope="col"{side}>{escape(each)}</th>'
        for side, each in zip(sides, block.headings, strict=True)
    )
    body = "".join(
        "<tr>"
        + "".join(f"<td{side}>{escape(cell)}</td>" for side, cell in zip(sides, row, strict=True))
        + "</tr>"
        for row in block.rows
    )
    caption = f"<caption>{escape(block.caption)}</caption>" if block.caption else ""
    return (
        f'<div class="table"><table>{caption}<thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )
