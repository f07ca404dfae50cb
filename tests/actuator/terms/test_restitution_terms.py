"""Restitution by the speed of the impact: by a power law, and from a table."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004")
SPEEDS, VALUES = (0.05, 0.2, 0.5, 1.0, 2.0), (0.9, 0.85, 0.6, 0.55, 0.3)
TABLE = mi.TabulatedRestitution(speeds=SPEEDS, values=VALUES)
POWER = mi.PowerLawRestitution(speed=0.3, exponent=0.25)
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
PLAIN = mi.Options(engine="interpreted", method="dop853")


def measured(term, speed):
    """The restitution of one impact of a block that starts at the stopper."""
    device = ZHAO.adding(term)
    start = mi.State(x2=0.5, v2=speed)
    run = mi.simulate(device, DRIVE, duration=1e-3, initial=start, options=PLAIN)
    hit = run.impacts.iloc[0]
    assert hit["v2 before"] == speed
    gained = (speed - hit["v2 after"]) * device.m2 / (device.m1 + device.m2)
    assert hit["v1 after"] == pytest.approx(gained, rel=1e-12)  # momentum
    return -hit["v2 after"] / speed


def test_power_law():
    for speed in (1e-4, 0.3, 30.0):
        found = measured(POWER, speed)
        assert found == pytest.approx(0.8 * (1.0 + (speed / 0.3) ** 2) ** -0.125, rel=1e-12)
    assert found == pytest.approx(0.8 * (30.0 / 0.3) ** -0.25, rel=1e-4)
    assert measured(mi.PowerLawRestitution(speed=0.3, exponent=0.0), 1.0) == pytest.approx(0.8)


def test_table():
    for speed, value in zip(SPEEDS, VALUES, strict=True):
        assert measured(TABLE, speed) == pytest.approx(value, rel=1e-13)
    assert measured(TABLE, 0.01) == pytest.approx(VALUES[0], rel=1e-15)
    assert measured(TABLE, 5.0) == pytest.approx(VALUES[-1], rel=1e-15)
    inner = PchipInterpolator(SPEEDS, VALUES)
    for speed in (0.21, 0.3, 0.45, 0.6, 0.99):  # away from the ends, where it turns to constant
        assert measured(TABLE, speed) == pytest.approx(float(inner(speed)), rel=1e-12)
    falls = [measured(TABLE, speed) for speed in np.linspace(0.04, 2.1, 60)]
    assert (np.diff(falls) <= 1e-15).all()


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"speeds": (0.2, 0.1), "values": (0.5, 0.6)}, "ascending"),
        ({"speeds": (0.1, 0.2), "values": (0.5, 0.6, 0.7)}, "2 numbers"),
        ({"speeds": (0.1,), "values": (0.5,)}, "speeds"),
        ({"speeds": (0.1, 0.2), "values": (0.5, 1.2)}, "values"),
    ],
)
def test_tables_are_checked(values, named):
    with pytest.raises(mi.InvalidParameter, match=named):
        mi.TabulatedRestitution(**values)


def test_an_actuator_has_one_restitution():
    for other in (POWER, mi.CompliantStopper(stiffness=1e4, damping=0.5)):
        with pytest.raises(mi.InvalidParameter, match="both determine the restitution"):
            ZHAO.adding(TABLE, other)


@pytest.mark.parametrize("term", [POWER, TABLE])
def test_a_sequence_of_impacts_ends_in_rest(term):
    # Pressed by 0.45 V: the last bounces are slow, and have the restitution of slow impacts.
    held = mi.Pulse(amplitude=0.45, period=26.0, width=16.0)
    run = mi.simulate(ZHAO.adding(term), held, 0.5, initial=mi.State(x2=0.4), options=PLAIN)
    slow = 0.8 if term is POWER else 0.9
    speeds = run.impacts["v2 before"].to_numpy()
    ratios = -run.impacts["v2 after"].to_numpy() / speeds
    assert speeds[-1] < 1e-3
    assert ratios[-1] == pytest.approx(slow, rel=1e-5)
    assert "chatter ends" in set(run.events["event"])
    assert run.events["mode after"].iloc[-1] == "stuck-right"
