"""Models of SBML with events, against closed forms; the runner on cases of these models."""

from __future__ import annotations

import math

import pytest

libsbml = pytest.importorskip("libsbml")

from validation.outside import __main__ as runner  # noqa: E402
from validation.outside.case import Refused  # noqa: E402
from validation.outside.sbml import values  # noqa: E402


def write(path, start, rates=(), events=(), **assigned):
    """Write a model: initial values of parameters, rate and assignment rules, events."""
    document = libsbml.SBMLDocument(3, 2)
    model = document.createModel()
    for name, value in start.items():
        parameter = model.createParameter()
        parameter.setId(name)
        parameter.setConstant(False)
        if isinstance(value, str):
            assignment = model.createInitialAssignment()
            assignment.setSymbol(name)
            assignment.setMath(libsbml.parseL3Formula(value))
        else:
            parameter.setValue(value)
    rules = [(model.createRateRule, dict(rates)), (model.createAssignmentRule, assigned)]
    for create, formulas in rules:
        for name, formula in formulas.items():
            rule = create()
            rule.setVariable(name)
            rule.setMath(libsbml.parseL3Formula(formula))
    for each in events:
        add_event(model, **each)
    libsbml.writeSBMLToFile(document, str(path))
    return str(path)


def add_event(
    model, when, then, delay=None, priority=None, persistent=True, initially=True, at_trigger=True
):
    event = model.createEvent()
    event.setUseValuesFromTriggerTime(at_trigger)
    trigger = event.createTrigger()
    trigger.setMath(libsbml.parseL3Formula(when))
    trigger.setPersistent(persistent)
    trigger.setInitialValue(initially)
    if delay is not None:
        event.createDelay().setMath(libsbml.parseL3Formula(delay))
    if priority is not None:
        event.createPriority().setMath(libsbml.parseL3Formula(priority))
    for name, formula in then.items():
        assignment = event.createEventAssignment()
        assignment.setVariable(name)
        assignment.setMath(libsbml.parseL3Formula(formula))


def table(path, variables, duration=2.0, steps=4):
    settings = {
        "start": "0",
        "duration": str(duration),
        "steps": str(steps),
        "variables": variables,
        "concentration": "",
        "absolute": "1e-6",
    }
    return list(zip(*values(path, settings), strict=True))


@pytest.mark.parametrize(("at_trigger", "kept"), [(True, 0.6), (False, 0.9)])
def test_delay(tmp_path, at_trigger, kept):
    event = {"when": "x > 0.6", "then": {"kept": "x"}, "delay": "0.3", "at_trigger": at_trigger}
    path = write(tmp_path / "m.xml", {"x": 0, "kept": 0}, {"x": "1"}, [event])
    (column,) = table(path, "kept")
    assert column == pytest.approx([0.0, 0.0, kept, kept, kept])


def test_two_executions_wait(tmp_path):
    """The trigger is true twice before the first of its delays has passed."""
    event = {
        "when": "sin(10 * time) > 0.5",
        "then": {"n": "n + 1"},
        "delay": "0.9",
        "at_trigger": False,
    }
    path = write(tmp_path / "m.xml", {"n": 0}, (), [event])
    (column,) = table(path, "n")
    first, period = math.pi / 60.0, math.pi / 5.0
    counts = [
        sum(first + k * period + 0.9 <= t for k in range(9)) for t in (0.0, 0.5, 1.0, 1.5, 2.0)
    ]
    assert column == pytest.approx(counts)
    assert counts[-1] == 2


@pytest.mark.parametrize(("first", "second", "result"), [("2", "1", 5.0), ("1", "2", 8.0)])
def test_priority(tmp_path, first, second, result):
    events = [
        {"when": "time >= 0.7", "then": {"x": "2 * x"}, "priority": first, "at_trigger": False},
        {"when": "time >= 0.7", "then": {"x": "x + 3"}, "priority": second, "at_trigger": False},
    ]
    path = write(tmp_path / "m.xml", {"x": 1}, (), events)
    (column,) = table(path, "x")
    assert column == pytest.approx([1.0, 1.0, result, result, result])


@pytest.mark.parametrize(("persistent", "result"), [(True, 1.0), (False, 0.0)])
def test_persistence(tmp_path, persistent, result):
    """A trigger that is false again when its delay ends, or by another event of its instant."""
    pulse = {"when": "time > 0.2 && time < 0.4", "then": {"x": "1"}, "delay": "0.6"}
    other = {"when": "time > 0.6", "then": {"on": "0"}, "priority": "2"}
    same = {"when": "time > 0.6 && on > 0", "then": {"y": "1"}, "priority": "1"}
    events = [{**pulse, "persistent": persistent}, other, {**same, "persistent": persistent}]
    path = write(tmp_path / "m.xml", {"x": 0, "y": 0, "on": 1}, (), events)
    x, y = table(path, "x, y")
    assert x == pytest.approx([0.0, 0.0, result, result, result])
    assert y == pytest.approx([0.0, 0.0, result, result, result])


@pytest.mark.parametrize(("initially", "result"), [(True, 2.0), (False, 5.0)])
def test_trigger_true_at_the_start(tmp_path, initially, result):
    """An initial assignment makes it true; what follows in the instant is an event in any case."""
    events = [
        {"when": "x > 1", "then": {"x": "5"}, "initially": initially},
        {"when": "x > 4", "then": {"y": "1"}},
    ]
    path = write(tmp_path / "m.xml", {"k": 1, "x": "2 * k", "y": 0}, (), events)
    x, y = table(path, "x, y")
    assert x == pytest.approx([result] * 5)
    assert y == pytest.approx([0.0 if initially else 1.0] * 5)


@pytest.mark.parametrize(("relation", "fires"), [(">=", 1.0), (">", 0.0), ("==", 1.0), ("!=", 0.0)])
def test_jump_to_equality(tmp_path, relation, fires):
    events = [
        {"when": "time > 0.6", "then": {"x": "1"}},
        {"when": f"x {relation} 1", "then": {"y": "y + 1"}},
    ]
    path = write(tmp_path / "m.xml", {"x": 0, "y": 0}, (), events)
    (column,) = table(path, "y")
    assert column == pytest.approx([0.0, 0.0, fires, fires, fires])


def test_rate_and_assignment_rules(tmp_path):
    event = {"when": "twice > 1", "then": {"x": "0"}, "at_trigger": False}
    path = write(
        tmp_path / "m.xml",
        {"x": 0, "twice": 0, "r": 0},
        {"x": "1"},
        [event],
        twice="2 * x",
        r="rateOf(x)",
    )
    twice, rate = table(path, "twice, r", duration=1.8, steps=3)
    assert twice == pytest.approx([2.0 * (t % 0.5) for t in (0.0, 0.6, 1.2, 1.8)])
    assert rate == pytest.approx([1.0] * 4)


def test_algebraic_rules_are_refused(tmp_path):
    document = libsbml.readSBML(write(tmp_path / "m.xml", {"x": 0}))
    rule = document.getModel().createAlgebraicRule()
    rule.setMath(libsbml.parseL3Formula("x - time"))
    libsbml.writeSBMLToFile(document, str(tmp_path / "m.xml"))
    with pytest.raises(Refused, match="algebraic rule"):
        table(str(tmp_path / "m.xml"), "x")


SETTINGS = """start: 0
duration: 1.5
steps: 3
variables: x
absolute: 1e-6
relative: 1e-4
amount:
concentration:
"""
RESULTS = "time,x\n0,0\n0.5,0.5\n1,0.1\n1.5,0.6\n"


@pytest.fixture
def suite(tmp_path):
    """A folder as that of the suite with one model, whose event sets x = t to 0 at 0.9."""
    case = tmp_path / "suite/cases/semantic/00001"
    case.mkdir(parents=True)
    event = {"when": "x > 0.9", "then": {"x": "0"}}
    write(case / "00001-sbml-l3v2.xml", {"x": 0}, {"x": "1"}, [event])
    (case / "00001-model.m").write_text("componentTags: EventNoDelay, RateRule\n")
    (case / "00001-settings.txt").write_text(SETTINGS)
    (case / "00001-results.csv").write_text(RESULTS)
    return tmp_path / "suite"


def verdict(suite, tmp_path):
    """Return the exit status of the runner and the verdict on the only case."""
    output = ["--output", str(tmp_path / "out"), "--workers", "1"]
    status = runner.main(["sbml", "--source", str(suite), *output])
    _, line = (tmp_path / "out/sbml.csv").read_text().splitlines()
    return status, line.split(",")[2]


def test_runner(suite, tmp_path, capsys):
    assert verdict(suite, tmp_path) == (0, "passed")
    assert "1, 1, 0" in capsys.readouterr().out
    (suite / "cases/semantic/00001/00001-results.csv").write_text(RESULTS.replace("0.6", "0.7"))
    assert verdict(suite, tmp_path) == (1, "failed")
    assert runner.main(["sbml", "--source", str(tmp_path / "nowhere")]) == 2
