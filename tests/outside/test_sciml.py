"""Tests of SciML whose systems compile fast, without the clone."""

from __future__ import annotations

import pytest

from validation.outside import sciml
from validation.outside.case import verdict

FAST = ("order_of_callbacks", "roots_in_one_step", "stuck_at_zero", "terminated")


@pytest.fixture
def cases(tmp_path):
    for test in sciml.TESTS:
        (tmp_path / test.file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / test.file).touch()
    return {case.name: case for case in sciml.cases(tmp_path)}


def test_names(cases, tmp_path):
    assert len(cases) == len(sciml.TESTS)
    assert list(sciml.cases(tmp_path / "nowhere")) == []


@pytest.mark.parametrize("name", FAST)
def test_verdict(cases, name):
    assert verdict(cases[name]).verdict == "passed"
