"""A relay with hysteresis: its limit cycle, and where it slides without one."""

from __future__ import annotations

import math

import pytest

import mems_impact as mi

PLAIN = mi.Options(engine="interpreted", method="dop853")


def room(mode, t, y, p):
    return (-y.T + (0.0 if mode.thermostat == 1 else p.power),)


def heated(**changes):
    return mi.System(
        states=("T",), flow=room, parameters={"power": 2.0, "low": 0.9, "high": 1.1},
        time_scale=1.0, **changes,
    )  # fmt: skip


def test_the_limit_cycle_of_a_thermostat():
    thermostat = mi.Relay("thermostat", "T", lower="low", upper="high")
    run = mi.simulate(heated(parts=[thermostat]), duration=10.0, options=PLAIN)
    rises = run.events.query("event == 'thermostat rises'")["t"].diff().iloc[1:]
    exact = math.log((2.0 - 0.9) / (2.0 - 1.1)) + math.log(1.1 / 0.9)
    assert rises.tolist() == pytest.approx([exact] * len(rises), rel=1e-8)
    assert len(rises) > 20


def test_between_the_thresholds_it_is_as_it_was():
    thermostat = mi.Relay("thermostat", lambda t, y, p: y.T, lower="low", upper="high")
    system = heated(parts=[thermostat])
    cold = mi.simulate(system, duration=0.01, initial={"T": 1.0}, options=PLAIN)
    assert cold.final.mode == "low"
    assert cold.final.T > 1.0
    warm = mi.simulate(system, duration=0.01, initial=mi.State(T=1.0, mode="high"), options=PLAIN)
    assert warm.final.mode == "high"
    assert warm.final.T < 1.0
    hot = mi.simulate(system, duration=0.01, initial={"T": 1.5}, options=PLAIN)
    assert hot.final.mode == "high"


@pytest.mark.parametrize("band", [0.0, 1e-12])
@pytest.mark.parametrize("method", ["dop853", "adams"])
def test_without_hysteresis_its_modes_push_against_each_other_and_it_says_so(band, method):
    thermostat = mi.Relay("thermostat", "T", lower=1.0, upper=1.0 + band)
    options = mi.Options(engine="interpreted", method=method, max_events=200)
    with pytest.raises(mi.RunError) as caught:
        mi.simulate(heated(parts=[thermostat]), duration=10.0, options=options)
    assert "modes 'low' and 'high' push against each other at 'thermostat" in str(caught.value)
    assert "mems_impact.SwitchingSurface" in caught.value.remedy


def test_modes_written_by_hand_that_push_against_each_other_are_reported():
    UP, DOWN = mi.modes("up", "down")

    def push(mode, t, y, p):
        return y.v, -1.0 if mode == UP else 1.0

    slider = mi.System(
        states=("x", "v"),
        flow=push,
        initial={"v": 1.0},
        guards=[
            mi.Guard(
                "falls", lambda mode, t, y, p: y.v, lambda mode, t, y, p: (DOWN, y), modes=(UP,)
            ),
            mi.Guard(
                "rises", lambda mode, t, y, p: -y.v, lambda mode, t, y, p: (UP, y), modes=(DOWN,)
            ),
        ],
    )  # fmt: skip
    with pytest.raises(mi.RunError, match="'up' and 'down' push against each other at 'falls' and"):
        mi.simulate(slider, duration=3.0, options=PLAIN)
