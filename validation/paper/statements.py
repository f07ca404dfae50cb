"""Statements of the paper as data, the rules by which they are judged, and the verdicts."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal

__all__ = ["Judgement", "Statement", "Verdict", "judge", "load_statements"]

Value = float | bool | str


class Verdict(StrEnum):
    """What the rule says."""

    AGREES = "agrees"
    DIFFERS = "differs"
    NOT_COMPUTED = "not computed"


@dataclass(frozen=True, kw_only=True)
class Statement:
    """One statement of the paper.

    Attributes
    ----------
    id : str
    figure : int
    section : str
        Of the paper.
    text : str
        The paper's words.
    what : str
        What is computed.
    value : float, bool or str
        What the paper says; a string of digits as printed, under the rule "printed".
    rule : {"printed", "within", "is"}
    tolerance : float
        Of the rule "within".
    why : str
        Where the tolerance comes from.
    """

    id: str
    figure: int
    section: str
    text: str
    what: str
    value: Value
    rule: Literal["printed", "within", "is"]
    tolerance: float = 0.0
    why: str = ""

    @property
    def allowed(self) -> float:
        """The largest difference that agrees."""
        if self.rule == "printed":
            exponent = Decimal(str(self.value)).as_tuple().exponent
            return float(Decimal("0.5").scaleb(int(exponent)))
        return self.tolerance if self.rule == "within" else 0.0

    @property
    def rule_in_words(self) -> str:
        """The rule as the report shows it."""
        match self.rule:
            case "printed":
                return f"difference <= half a unit of the last printed digit ({self.allowed:g})"
            case "within":
                return f"difference <= {self.tolerance:g}: {self.why}"
            case "is":
                return "equal"


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """A statement beside what was computed.

    Attributes
    ----------
    statement : Statement
    computed : float, bool, str or None
        None if it could not be computed.
    difference : float
        Computed less stated; NaN where there is no such number.
    verdict : Verdict
    """

    statement: Statement
    computed: Value | None
    difference: float
    verdict: Verdict


def judge(statement: Statement, computed: Value | None) -> Judgement:
    """Apply the rule of a statement to a computed value."""
    difference, agrees = math.nan, False
    if isinstance(computed, float) and not math.isfinite(computed):
        computed = None
    if computed is None:
        verdict = Verdict.NOT_COMPUTED
    else:
        if isinstance(computed, bool | str):
            agrees = statement.rule == "is" and computed == statement.value
        else:
            difference = float(computed) - float(statement.value)
            agrees = abs(difference) <= statement.allowed
        verdict = Verdict.AGREES if agrees else Verdict.DIFFERS
    return Judgement(statement=statement, computed=computed, difference=difference, verdict=verdict)


def load_statements() -> tuple[Statement, ...]:
    """Return all statements, in the order of the figures."""
    raw = Path(__file__).with_name("statements.toml").read_text("utf-8")
    entries: list[Mapping[str, Any]] = tomllib.loads(raw)["statement"]
    return tuple(Statement(**entry) for entry in entries)
