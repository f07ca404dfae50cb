"""The suite on its quickest figures: files, verdicts that change with the device, diagram."""

import csv
from pathlib import Path

import pandas as pd
import pytest

import mems_impact as mi
from validation.paper.figures import Devices, Effort
from validation.paper.statements import load_statements
from validation.paper.suite import changed_verdicts, expected_verdicts, run_suite
from validation.paper.transitions import transitions

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
EXPECTED = ROOT / "validation" / "expected-verdicts.csv"
QUICK = Effort(quick=True)


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    return tmp_path_factory.mktemp("validation") / "new"


@pytest.fixture(scope="module")
def device_report(directory):
    return run_suite([3], effort=QUICK, output=directory)


def test_files_of_a_figure(device_report, directory):
    names = {path.name for path in directory.iterdir()}
    assert names == {Path(name).name for name in device_report.written}
    assert {"figure3.png", "figure3.svg", "figure3-displacement.csv", "verdicts.csv"} < names
    markdown = (directory / "report.md").read_text()
    page = (directory / "report.html").read_text()
    for text in (markdown, page):
        assert "two impacts in one excitation cycle" in text
        assert "3.displacement" in text
        assert "agrees" in text
    table = pd.read_csv(directory / "figure3-displacement.csv")
    assert table["displacement per blow [m]"].max() > 2e-8
    rows = list(csv.DictReader((directory / "verdicts.csv").open()))
    assert [row["id"] for row in rows] == ["3.displacement", "3.two-impacts"]


def test_a_perturbed_device_changes_the_verdict(device_report):
    assert device_report.verdicts["3.displacement"] == "agrees"
    real = mi.load_actuator("mita2003")
    other = run_suite([3], effort=QUICK, devices=Devices(real=real.replace(k=1.1 * real.k)))
    assert other.verdicts["3.displacement"] == "differs"
    assert "1 differs (3.displacement)" in str(other)
    lines = changed_verdicts(other, device_report.verdicts)
    assert lines == ["3.displacement: differs, was: agrees"]


def test_a_perturbed_paper_set_changes_verdicts():
    expected = expected_verdicts(EXPECTED)
    paper = mi.load_actuator("zhao2004")
    report = run_suite([4], effort=QUICK, devices=Devices(paper=paper.replace(delta=0.2)))
    assert changed_verdicts(report, expected)


def test_expected_verdicts_cover_all_statements():
    assert set(expected_verdicts(EXPECTED)) == {s.id for s in load_statements()}


def test_other_processes_give_the_same(device_report):
    both = run_suite([2, 3], effort=QUICK, processes=2)
    assert [j.statement.figure for j in both.judgements] == [2] * 5 + [3] * 2
    assert both.judgements[-2:] == device_report.judgements


def test_bad_input(tmp_path):
    with pytest.raises(mi.InvalidParameter, match="figure = 1"):
        run_suite([1])
    with pytest.raises(mi.InvalidFile, match="cannot be read"):
        expected_verdicts(tmp_path / "none.csv")
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    with pytest.raises(mi.InvalidFile, match="no verdicts"):
        expected_verdicts(tmp_path / "bad.csv")


def test_the_diagram_shows_the_rules():
    found = set(transitions(mi.load_actuator("zhao2004"), 4000))
    modes = {name: i for i, name in enumerate(mi_modes())}
    assert (modes["stuck-free"], 0, modes["forward-free"]) in found  # right impact
    assert (modes["stuck-free"], 1, modes["backward-free"]) in found  # left impact
    assert (modes["forward-free"], 3, modes["stuck-free"]) in found  # slip end
    assert (modes["stuck-right"], 2, modes["stuck-free"]) in found  # release
    # Spring and attraction both push a block off the left stopper, unless friction holds the
    # frame back.
    reached = {after for _, _, after in found} | {before for before, _, _ in found}
    assert modes["stuck-left"] not in reached
    assert modes["forward-left"] not in reached
    # An impact on the right pushes forward.
    assert not any(b == modes["backward-free"] for a, c, b in found if c == 0 and a == 0)


def mi_modes():
    from mems_impact.actuator.automaton import MODES

    return MODES
