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


ZEROS = "".join(f"0\t{zero}\t1e-9\tpass\n" for zero in range(1, 11))  # of sin(pi t)
HITS = "Ball hit the ground at t =  4.08 seconds\nBall hit the ground at t =  7.76 seconds\n"
ASSERTIONS = "assert abs(y[-1][0] - 8.0) < 1e-6\n    assert abs(y[-1][1] - 3.0) < 1e-6\n"


@pytest.mark.parametrize(
    ("suite", "folder", "right", "wrong"),
    [
        ("petsc", "src/ts/event/tests/output", {"ex1sin_0.out": ZEROS}, {"ex1sin_n.out": ZEROS}),
        (
            "petsc",
            "src/ts/tutorials/output",
            {"ex40.out": HITS},
            {"ex40_m.out": HITS.replace("7.76", "7.78")},
        ),
        (
            "assimulo",
            "examples",
            {"euler_with_disc.py": ASSERTIONS},
            {"ida_with_disc.py": ASSERTIONS.replace("3.0", "3.1")},
        ),
    ],
    ids=["zeros", "bouncing balls", "assimulo"],
)
def test_a_wrong_number_fails(suite, folder, right, wrong, tmp_path, capsys):
    (tmp_path / folder).mkdir(parents=True)
    for name, text in (right | wrong).items():
        (tmp_path / folder / name).write_text(text)
    arguments = [suite, "--source", str(tmp_path), "--output", str(tmp_path / "out")]
    assert runner.main([*arguments, "--workers", "1"]) == 1
    lines = (tmp_path / f"out/{suite}.csv").read_text().splitlines()[1:]
    assert [line.split(",")[2] for line in lines] == ["passed", "failed"]
    assert "2, 1, 1" in capsys.readouterr().out


def test_missing_library(tmp_path, monkeypatch, capsys):
    for name in [name for name in sys.modules if name.startswith("validation.outside.sbml")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "libsbml", None)
    assert runner.main(["sbml", "--source", str(tmp_path)]) == 2
    assert "pip install" in capsys.readouterr().err
