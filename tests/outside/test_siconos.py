"""The comparison with reference files of Siconos, on files of closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from validation.outside import siconos
from validation.outside.case import verdict

TIMES = np.arange(0.0, 1.0001, 0.005)


def heights(times):
    """A ball that falls from 1 and bounces once with e = 0.9."""
    impact, speed = math.sqrt(2.0 / 9.81), math.sqrt(2.0 * 9.81)
    after = np.maximum(times - impact, 0.0)
    down = 1.0 - 0.5 * 9.81 * times**2
    return np.where(times < impact, down, 0.9 * speed * after - 0.5 * 9.81 * after**2)


@pytest.mark.parametrize(
    ("name", "delay", "error"),
    [
        (siconos.BALLS, 0.0, 0.0),
        (siconos.BALLS, 0.005, 0.022),  # of the range: a step at the impact speed
        (siconos.STEPPING, 0.005, 0.0),
        (siconos.STEPPING, 0.1, math.inf),
    ],
)
def test_distance(tmp_path, name, delay, error):
    """Only references of time stepping may be late by some steps."""
    table = np.column_stack([TIMES, heights(np.maximum(TIMES - delay, 0.0))])
    path = tmp_path / "ball.ref"
    np.savetxt(path, table, header=f"{len(table)} 2", comments="")
    example = siconos.EXAMPLES[name]
    example = siconos.Example(example.system, {"x": 1}, example.rate, example.late)
    distance = siconos.distance(example, path)
    if error == math.inf:
        assert distance > example.tolerance
    else:
        assert distance == pytest.approx(error, abs=1e-3)


def test_refusals(tmp_path):
    cases = list(siconos.cases(tmp_path))
    refused = [verdict(case) for case in cases if case.group == "refused"]
    assert len(cases) == len({case.name for case in cases})
    assert {result.note for result in refused} == set(siconos.REFUSED)
