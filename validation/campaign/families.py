"""Systems other than the actuator, family by family, each case before a reference of its own.

``python -m validation.campaign --only cradles`` runs one family, ``--only cradles:17`` one case.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from validation.campaign import (
    automata,
    clocks,
    contacts,
    corrugated,
    cradles,
    derivatives,
    expressions,
    pool,
    run_derivatives,
    scales,
    settling,
    surfaces,
    tables,
    terms,
)
from validation.campaign.comparing import Unit, Verdict


@dataclass(frozen=True)
class Family:
    """How to try a case of a family, and how many make a full run and a small one."""

    check: Callable[[int, int, Unit], Verdict]
    full: int
    few: int


FAMILIES = {
    "tables": Family(tables.check, 400, 5),
    "corrugated": Family(corrugated.check, 2000, 60),
    "cradles": Family(cradles.check, 1000, 12),
    "clocks": Family(clocks.check, 3000, 30),
    "derivatives": Family(derivatives.check, 2000, 2),
    "expressions": Family(expressions.check, 2000, 30),
    "automata": Family(automata.check, 15_600, 20),
    "guards": Family(automata.check_guards, 2500, 20),
    "scales": Family(scales.check, 1000, 10),
    "contacts": Family(contacts.check, 5000, 8),
    "terms": Family(terms.check, 5000, 9),
    "run_derivatives": Family(run_derivatives.check, 5000, 2),
    "settling": Family(settling.check, 2400, 16),
    "surfaces": Family(surfaces.check, 2100, 6),
}

_Item = tuple[str, int, int, str]  # family, seed, number, method


def one(item: _Item) -> Verdict:
    """Try one case; an error of the campaign itself is a finding too."""
    name, seed, number, method = item
    try:
        return FAMILIES[name].check(seed, number, Unit(method=method))
    except Exception as error:
        story = f"campaign failed: {type(error).__name__}: {error}"
        return Verdict(name, number, story=story)


def _lost(item: _Item, why: str) -> Verdict:
    return Verdict(item[0], item[2], story=f"no answer: {why}")


def run(
    seed: int,
    names: Iterable[str] = tuple(FAMILIES),
    first: int = 0,
    cases: int | None = None,
    workers: int = 1,
    small: bool = False,
    show: bool = False,
    method: str = Unit.method,
) -> list[Verdict]:
    """Try `cases` of each family from number `first` on; by default as many as it has to have."""
    items: list[_Item] = []
    for name in names:
        family = FAMILIES[name]
        count = (family.few if small else family.full) if cases is None else cases
        items += [(name, seed, number, method) for number in range(first, first + count)]
    verdicts = []
    began = time.monotonic()
    for verdict in pool.each(one, items, workers, _lost):
        verdicts.append(verdict)
        if show and verdict.story:
            print(f"{verdict} [{rerun(seed, verdict, method)}]", file=sys.stderr)
        if show and len(verdicts) % 500 == 0:
            seconds = time.monotonic() - began
            print(f"{len(verdicts)} of {len(items)} cases in {seconds:.0f} s", file=sys.stderr)
    return sorted(verdicts, key=lambda verdict: (verdict.family, verdict.number))


def rerun(seed: int, verdict: Verdict, method: str) -> str:
    """Return how to try the case again alone."""
    case = f"{verdict.family}:{verdict.number}"
    chosen = "" if method == Unit.method else f" --method {method}"
    return f"python -m validation.campaign --seed {seed} --only {case}{chosen}"


def table(seed: int, verdicts: list[Verdict], method: str = Unit.method) -> list[str]:
    """Return lines of Markdown: a row a family, and all that is wrong."""
    lines = ["| family | cases | events matched | horizon | wrong |", "|---|---|---|---|---|"]
    for name in FAMILIES:
        some = [verdict for verdict in verdicts if verdict.family == name]
        if some:
            events = sum(verdict.events for verdict in some)
            horizon = sum(verdict.horizon for verdict in some) / len(some)
            wrong = sum(bool(verdict.story) for verdict in some)
            lines.append(f"| {name} | {len(some)} | {events} | {horizon:.3f} | {wrong} |")
    wrong_ones = [verdict for verdict in verdicts if verdict.story]
    told = (f"- {verdict} [{rerun(seed, verdict, method)}]" for verdict in wrong_ones)
    return [*lines, "", *told]
