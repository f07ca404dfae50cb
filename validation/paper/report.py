"""The report: every statement of the paper beside what was computed, in Markdown and HTML."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence

from validation.paper.statements import Judgement, Value, Verdict

__all__ = ["summary", "to_html", "to_markdown"]

TITLES = {
    2: "Fig. 2: the automaton",
    3: "Fig. 3: displacement per blow of the real device",
    4: "Fig. 4: type I, omega = 0.5",
    5: "Fig. 5: type II, omega = 0.485",
    6: "Fig. 6: type III, omega = 0.45",
    7: "Fig. 7: voltages of switching over the frequency",
}
HEADINGS = (
    "",
    "the paper says",
    "computed is",
    "paper",
    "computed",
    "difference",
    "rule",
    "verdict",
)
INTRODUCTION = (
    "What the paper states, beside what this package computes. The statements and the rules by "
    "which they are judged stand in validation/paper/statements.toml and were written before "
    "the runs (7.boundaries was revised after one, as it says there); nothing is tuned, and a "
    "difference is shown as one."
)


def summary(judgements: Sequence[Judgement]) -> str:
    """Return how many statements got each verdict, and which do not agree."""
    counts = {verdict: sum(j.verdict is verdict for j in judgements) for verdict in Verdict}
    text = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count)
    others = [j.statement.id for j in judgements if j.verdict is not Verdict.AGREES]
    return f"{len(judgements)} statements: {text}" + (f" ({', '.join(others)})" if others else "")


def to_markdown(
    judgements: Sequence[Judgement], notes: Mapping[int, tuple[str, ...]], effort: str
) -> str:
    """Return the report in Markdown, for the directory in which the figures are."""
    lines = ["# The paper against the code", "", INTRODUCTION, "", f"Effort: {effort}.", ""]
    lines += [f"{summary(judgements)}.", ""]
    for number, remarks in notes.items():
        lines += [f"## {TITLES[number]}", "", f"![{TITLES[number]}](figure{number}.png)", ""]
        lines += ["| " + " | ".join(HEADINGS) + " |", "|" + "---|" * len(HEADINGS)]
        for row in _rows(judgements, number):
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |")
        lines.append("")
        lines += [f"- {note}" for note in remarks]
        lines.append("")
    return "\n".join(lines)


def to_html(
    judgements: Sequence[Judgement], notes: Mapping[int, tuple[str, ...]], effort: str
) -> str:
    """Return the report as one HTML page, for the directory in which the figures are."""
    body = [f"<h1>The paper against the code</h1><p>{html.escape(INTRODUCTION)}</p>"]
    body.append(f"<p>Effort: {effort}.</p><p><b>{html.escape(summary(judgements))}.</b></p>")
    for number, remarks in notes.items():
        title = html.escape(TITLES[number])
        body.append(f'<h2>{title}</h2><img src="figure{number}.svg" alt="{title}">')
        body.append("<table><tr>" + "".join(f"<th>{h}</th>" for h in HEADINGS) + "</tr>")
        for row in _rows(judgements, number):
            kind = "good" if row[-1] == Verdict.AGREES else "bad"
            cells = "".join(f"<td>{html.escape(cell)}</td>" for cell in row)
            body.append(f'<tr class="{kind}">{cells}</tr>')
        body.append("</table>")
        listed = "".join(f"<li>{html.escape(note)}</li>" for note in remarks)
        body.append(f"<ul>{listed}</ul>" if listed else "")
    return PAGE.format(body="\n".join(body))


PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>The paper against the code</title>
<style>
body {{ font: 15px/1.45 sans-serif; max-width: 76rem; margin: 2rem auto; padding: 0 1rem; }}
img {{ max-width: 46rem; width: 100%; }}
table {{ border-collapse: collapse; margin: 1rem 0; font-size: 13px; }}
td, th {{ border: 1px solid #ccc; padding: 0.3rem 0.5rem; text-align: left; vertical-align: top; }}
tr.bad td:last-child {{ background: #f6d5c6; font-weight: bold; }}
tr.good td:last-child {{ background: #d8eedf; }}
</style></head><body>
{body}
</body></html>
"""


def _rows(judgements: Sequence[Judgement], figure: int) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for j in judgements:
        s = j.statement
        if s.figure != figure:
            continue
        difference = "" if math.isnan(j.difference) else f"{j.difference:.2g}"
        rows.append((
            s.id, f"“{s.text}” ({s.section})", s.what, _shown(s.value), _shown(j.computed),
            difference, s.rule_in_words, str(j.verdict),
        ))  # fmt: skip
    return rows


def _shown(value: Value | None) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return value if isinstance(value, str) else f"{value:.9g}"
