"""Limits of the rate of a state against closed forms."""

from __future__ import annotations

import math

import pytest

import mems_impact as mi

PLAIN = mi.Options(engine="interpreted", method="dop853")


def test_a_source_saturates_in_both_directions():
    def charging(mode, t, y, p):
        demand = 5.0 if t < 4.0 else -5.0
        return ((demand - y.q) / p.time,)

    source = mi.System(
        states=("q",), flow=charging, parameters={"time": 0.5, "most": 2.0},
        switches=(4.0,), parts=[mi.RateLimit("source", "q", limit="most")],
    )  # fmt: skip
    run = mi.simulate(source, duration=12.0, options=PLAIN)
    # Limited until the demand is a unit away, then exponential.
    held = 5.0 - math.exp(-(4.0 - 2.0) / 0.5)
    times = [2.0, 4.0, 4.0 + (held + 4.0) / 2.0]
    assert run.events["t"].tolist() == pytest.approx(times, rel=1e-8)
    assert run.events["mode after"].tolist() == ["within", "smallest", "within"]
    assert run.final.q == pytest.approx(-5.0 + math.exp(-(12.0 - times[2]) / 0.5), rel=1e-7)


def test_a_limit_must_be_positive():
    with pytest.raises(mi.InvalidParameter, match="limit of 'source'"):
        mi.System(
            states=("q",), flow=lambda mode, t, y, p: (1.0,),
            parts=[mi.RateLimit("source", "q", limit=0.0)],
        )  # fmt: skip
