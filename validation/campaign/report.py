"""The report: Markdown for people, CSV for everything else."""

from __future__ import annotations

import csv
import platform
from collections import Counter
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path

import numpy as np

from validation.campaign import families
from validation.campaign.cases import random_case
from validation.campaign.checks import GAINS, SHORT, Outcome, check
from validation.campaign.comparing import Unit, Verdict
from validation.campaign.result import Result


def markdown(
    seed: int,
    outcomes: list[Outcome],
    results: list[Result],
    verdicts: list[Verdict],
    method: str | None = None,
) -> str:
    """Return the report."""
    chosen = f", method {method}" if method else ""
    lines = ["# Campaign", "", f"Seed {seed}{chosen}; mems_impact {version('mems-impact')} on "]
    lines[-1] += f"Python {platform.python_version()}, {platform.machine()}."
    if outcomes:
        lines += ["", "## Random runs", "", *_figures(outcomes), ""]
        lines += ["| drive | runs | impacts | rests | matched | horizon | findings |"]
        lines += ["|---|---|---|---|---|---|---|"]
        for kind in sorted({outcome.kind for outcome in outcomes}):
            some = [outcome for outcome in outcomes if outcome.kind == kind]
            share = np.mean([outcome.horizon for outcome in some])
            cells = [kind, len(some), _sum(some, "impacts"), _sum(some, "rests")]
            cells += [_sum(some, "matched"), f"{share:.2f}", sum(bool(o.findings) for o in some)]
            lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
        lines += ["", "How they ended:", ""]
        for status, count in Counter(outcome.status for outcome in outcomes).most_common():
            lines.append(f"- {status}: {count}")
        found = [outcome for outcome in outcomes if outcome.findings]
        lines += ["", f"Findings: {len(found)}", ""]
        lines += [f"- {o.name} ({o.kind}, {o.status}): {'; '.join(o.findings)}" for o in found]
    if results:
        lines += ["", "## Aimed attacks", "", "| attack | tried | figures | findings |"]
        lines += ["|---|---|---|---|"]
        for result in results:
            count = len(result.findings) or "none"
            lines.append(f"| {result.name} | {result.tried} | {result.figures} | {count} |")
        for result in results:
            lines += [f"- {result.name}: {finding}" for finding in result.findings]
    if verdicts:
        lines += [
            "",
            "## Other systems",
            "",
            *families.table(seed, verdicts, method or Unit.method),
        ]
    return "\n".join(lines) + "\n"


def _figures(outcomes: list[Outcome]) -> list[str]:
    done = [outcome for outcome in outcomes if outcome.status == "result"]
    balanced = [outcome for outcome in done if outcome.energy > 0.0]
    lines = [
        f"- runs: {len(outcomes)}, of {sum(o.periods for o in outcomes):.0f} forcing periods",
        f"- events matched with the judge: {_sum(outcomes, 'matched')}; impacts of the package: "
        f"{_sum(outcomes, 'impacts')}, ends of slips: {_sum(outcomes, 'slips')}, rests: "
        f"{_sum(outcomes, 'rests')}",
        f"- share of a run over which the two agree, mean: "
        f"{np.mean([o.horizon for o in outcomes]):.3f}; to the end in "
        f"{sum(o.horizon == 1.0 for o in outcomes)} runs; they part as runs of 3, 30, 300 "
        f"tolerances' noise do in "
        f"{', '.join(str(sum(o.gain == g for o in outcomes)) for g in GAINS)}",
        f"- deepest penetration, parts of the gap: {max(o.penetration for o in outcomes):.1e}",
        f"- momentum at an impact, worst: {max(o.momentum for o in outcomes):.1e}",
        f"- on both engines: {sum(o.engines > 0.0 for o in outcomes)}, of which whole: "
        f"{sum(o.engines == 1.0 for o in outcomes)}; periods: "
        f"{sum(o.engines * o.periods for o in outcomes):.0f}",
        f"- slowest run: {max(o.seconds for o in outcomes):.2f} s",
    ]
    if balanced:
        energy = np.array([o.energy for o in balanced])
        impulse = np.array([o.impulse for o in balanced])
        lines.append(
            f"- energy unaccounted for in {len(balanced)} runs: median {np.median(energy):.1e}, "
            f"worst {energy.max():.1e}; momentum: {np.median(impulse):.1e}, {impulse.max():.1e}"
        )
    return lines


def _sum(outcomes: list[Outcome], name: str) -> int:
    return sum(int(getattr(outcome, name)) for outcome in outcomes)


def write_csv(path: Path, outcomes: list[Outcome]) -> None:
    """Write one line a run."""
    names = [field.name for field in fields(Outcome) if field.name != "other"]
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(names)
        for outcome in outcomes:
            row = [getattr(outcome, name) for name in names]
            table.writerow(["; ".join(v) if isinstance(v, list) else v for v in row])


def one(seed: int, number: int, method: str | None = None) -> str:
    """Return one random run in words."""
    case = random_case(seed, number).by(method)
    return f"{case}\n\n{check(case, interpreted=SHORT, energy='compiled')}"
