"""The runner of outside suites, without the suites."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from validation.outside import __main__ as runner
from validation.outside import tables
from validation.outside.case import Case, Refused, verdict


def case(values, **changes):
    """Return a case with the reference 1, 100."""
    tolerances = {"absolute": 0.0, "relative": 0.01}
    reference = [1.0, 100.0]
    given = {"name": "a", "group": "b", "reference": reference, **tolerances, **changes}
    return Case(values=lambda: values, **given)


@pytest.mark.parametrize(
    ("values", "expected", "error"),
    [
        ([1.005, 100.0], "passed", 0.5),
        ([1.0, 102.0], "failed", 2.0),
        ([1.0, np.nan], "failed", np.inf),
        ([1.0, 100.0, 1.0], "failed", np.nan),
    ],
)
def test_verdict(values, expected, error):
    result = verdict(case(values))
    assert result.verdict == expected
    assert result.error == pytest.approx(error, nan_ok=True)


def test_numbers_without_a_value_agree():
    result = verdict(case([np.nan, np.inf], reference=[np.nan, np.inf]))
    assert (result.verdict, result.error) == ("passed", 0.0)


def refuse():
    raise Refused("delay")


def test_summary_counts_by_group_and_reason():
    cases = [case([1.0, 100.0]), case([2.0, 2.0]), *2 * [replace(case([]), values=refuse)]]
    results = list(map(verdict, cases))
    assert tables.summary("s", "1f", results) == [("s", "1f", "b", "4", "1", "1", "2 delay")]


def test_record_replaces_the_lines_of_one_suite(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "SUMMARY", tmp_path / "results.csv")
    tables.record("two", [("two", "old")])
    tables.record("one", [("one", "x")])
    tables.record("two", [("two", "new")])
    lines = (tmp_path / "results.csv").read_text().splitlines()
    assert lines == [",".join(tables.HEADER), "one,x", "two,new"]


def test_petsc(tmp_path, capsys):
    """Zeros of sin(pi t), one of them wrong in the second output."""
    folder = tmp_path / "src/ts/event/tests/output"
    folder.mkdir(parents=True)
    lines = [f"0\t{zero}\t1e-9\tpass\n" for zero in range(1, 11)]
    (folder / "ex1sin_0.out").write_text("".join(lines))
    (folder / "ex1sin_n.out").write_text("".join(lines))
    arguments = ["petsc", "--source", str(tmp_path), "--output", str(tmp_path / "out")]
    assert runner.main(arguments) == 1
    verdicts = [line.split(",")[1:3] for line in (tmp_path / "out/petsc.csv").open()][1:]
    assert verdicts == [["ex1sin_0", "passed"], ["ex1sin_n", "failed"]]  # five zeros fall
    assert "2, 1, 1" in capsys.readouterr().out


def test_missing_library(tmp_path, monkeypatch, capsys):
    for name in [name for name in sys.modules if name.startswith("validation.outside.sbml")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "libsbml", None)
    assert runner.main(["sbml", "--source", str(tmp_path)]) == 2
    assert "pip install" in capsys.readouterr().err
