"""Cases of outside suites: a system, a reference, tolerances; their verdicts."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from mems_impact.errors import MemsImpactError

__all__ = ["Case", "Refused", "Result", "Suite", "verdict"]

PASSED, REFUSED, FAILED = "passed", "refused", "failed"


class Refused(Exception):
    """The reason why a case is outside what the package, or the translator, computes."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case of a suite.

    Attributes
    ----------
    name, group : str
        The group is a line of the table.
    values : callable
        Builds the system, runs it, and returns the values that the reference holds; raises
        `Refused`.
    reference : array_like or callable
        Numbers of the suite, or a function that reads them.
    absolute, relative : float
        Tolerances of the suite: ``|value - reference| <= absolute + relative |reference|``.
    """

    name: str
    group: str
    values: Callable[[], Any]
    reference: Any
    absolute: float
    relative: float


@dataclass(frozen=True)
class Suite:
    """A suite of others.

    Attributes
    ----------
    repository, licence, files : str
        Where the suite is found, and which of its files are read.
    cases : callable
        ``cases(folder)`` yields the cases.
    """

    repository: str
    licence: str
    files: str
    cases: Callable[[Any], Iterator[Case]]


@dataclass(frozen=True)
class Result:
    """The verdict of a case.

    Attributes
    ----------
    error : float
        Largest difference from the reference, in units of the tolerance.
    note : str
        Reason or message.
    """

    case: Case
    verdict: str
    error: float = float("nan")
    note: str = ""


def verdict(case: Case) -> Result:
    """Run a case and compare it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            values = np.asarray(case.values(), dtype=float)
    except Refused as reason:
        return Result(case, REFUSED, note=str(reason))
    except (MemsImpactError, ArithmeticError, ValueError) as problem:
        return Result(case, FAILED, note=f"{type(problem).__name__}: {problem}")
    reference = np.asarray(case.reference, dtype=float)
    if values.shape != reference.shape:
        return Result(case, FAILED, note=f"{values.shape} numbers, reference {reference.shape}")
    error = excess(values, reference, case)
    return Result(case, PASSED if error <= 1.0 else FAILED, error)


def excess(values: Any, reference: Any, case: Case) -> float:
    """Return the largest difference in units of the tolerance; infinities and nan must agree."""
    same = (values == reference) | (np.isnan(values) & np.isnan(reference))
    with np.errstate(invalid="ignore"):
        allowed = case.absolute + case.relative * np.abs(reference)
        errors = np.where(same, 0.0, np.abs(values - reference) / allowed)
    return float(np.nan_to_num(errors, nan=np.inf).max(initial=0.0))
