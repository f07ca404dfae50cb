"""The statements are well formed, and every rule can fail."""

import math

import pytest

from validation.paper.figures import FIGURES
from validation.paper.statements import Statement, Verdict, judge, load_statements

STATEMENTS = load_statements()


def statement(value, rule, tolerance=0.0):
    return Statement(
        id="x", figure=4, section="4", text="", what="", value=value, rule=rule,
        tolerance=tolerance, why="it is a test",
    )  # fmt: skip


def test_statements_are_well_formed():
    assert len({s.id for s in STATEMENTS}) == len(STATEMENTS)
    assert {s.figure for s in STATEMENTS} == set(FIGURES)
    for s in STATEMENTS:
        assert s.id.startswith(f"{s.figure}.")
        assert s.text
        assert s.what
        assert s.rule in ("printed", "within", "is")
        if s.rule == "within":
            assert s.tolerance > 0.0
            assert s.why
        if s.rule == "printed":
            assert isinstance(s.value, str)
            assert s.value in s.text


@pytest.mark.parametrize(
    ("printed", "allowed"), [("0.2356", 5e-5), ("0.480", 5e-4), ("20", 0.5), ("1.0", 0.05)]
)
def test_printed_digits(printed, allowed):
    s = statement(printed, "printed")
    assert math.isclose(s.allowed, allowed)
    value = float(printed)
    assert judge(s, value + 0.99 * allowed).verdict is Verdict.AGREES
    assert judge(s, value - 1.01 * allowed).verdict is Verdict.DIFFERS


def test_within():
    s = statement(20.0, "within", 0.2)
    assert judge(s, 20.19).verdict is Verdict.AGREES
    far = judge(s, 20.21)
    assert far.verdict is Verdict.DIFFERS
    assert math.isclose(far.difference, 0.21)


@pytest.mark.parametrize(
    ("value", "computed", "agrees"),
    [
        (True, True, True), (True, False, False), ("II", "II", True), ("II", "I", False),
        (1.0, 1.0, True), (1.0, 0.0, False), (0.0, 1e-300, False),
    ],
)  # fmt: skip
def test_is(value, computed, agrees):
    assert (judge(statement(value, "is"), computed).verdict is Verdict.AGREES) == agrees


@pytest.mark.parametrize("computed", [None, math.nan, math.inf])
def test_nothing_is_no_agreement(computed):
    for s in (statement(0.0, "within", 1.0), statement(0.0, "is"), statement("0.5", "printed")):
        assert judge(s, computed).verdict is Verdict.NOT_COMPUTED
