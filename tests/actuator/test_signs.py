"""Voltages whose sign changes from one forcing period to the next, where it matters."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.terms.base import Term, TermContribution
from tests.actuator.waveforms import DRIVES, SINE, channels

ZHAO = mi.load_actuator("zhao2004")
INTERPRETED = mi.Options(method="dop853", engine="interpreted", rtol=1e-11, atol=1e-13)

TRIANGLE = mi.Trapezoid(amplitude=0.3, omega=0.5, flat=0.0, phase=0.4)
FLANKS = mi.Square(amplitude=0.3, omega=0.5, low=-0.3, rise=2.0, phase=0.9)
# The same waves told over a whole turn: so little of a bias changes no voltage.
WHOLE = {
    "triangle": (TRIANGLE, TRIANGLE.replace(bias=1e-17)),
    "trapezoid, far ahead": (
        TRIANGLE.replace(flat=0.3, phase=17.0), TRIANGLE.replace(flat=0.3, phase=17.0, bias=1e-17),
    ),
    "trapezoid, behind": (
        TRIANGLE.replace(flat=0.3, phase=-4.0), TRIANGLE.replace(flat=0.3, phase=-4.0, bias=1e-17),
    ),
    "square": (FLANKS, FLANKS.replace(low=-0.3 * (1.0 - 1e-15))),
    "square, behind": (
        FLANKS.replace(phase=-2.0), FLANKS.replace(phase=-2.0, low=-0.3 * (1.0 - 1e-15)),
    ),
    "sine": (SINE, SINE.replace(bias=1e-17)),
}  # fmt: skip
BOTH = {
    "one to one": mi.Voltages(right=TRIANGLE, left=TRIANGLE.replace(phase=1.3)),
    "two to one": mi.Voltages(right=TRIANGLE, left=FLANKS.replace(omega=0.25, rise=1.0)),
    "three to two": mi.Voltages(right=TRIANGLE.replace(omega=0.75), left=FLANKS),
    "one side alone": mi.Voltages(
        right=TRIANGLE, left=mi.Pulse(amplitude=0.3, period=TRIANGLE.period, width=2.0)
    ),
    "a burst": mi.Burst(wave=TRIANGLE, on=3.0, off=2.0),
    "an even burst": mi.Burst(wave=mi.Trapezoid(amplitude=0.3, omega=0.5), on=2.5, off=1.5),
}


def cubed(t, q):
    return q[0] * math.sin(q[1] * t) ** 3


class Nothing(Term):
    """A term that makes the sign matter, and does nothing."""

    signed = True

    @classmethod
    def contribution(cls, indices, shape):
        return TermContribution()


def times(drive):
    """Places in two forcing periods, away from switches."""
    period = drive.period
    return [2.0 * period * (i + 0.3819) / 101 for i in range(101)]


@pytest.mark.parametrize(("drive", "whole"), WHOLE.values(), ids=list(WHOLE))
def test_the_sign_is_that_of_the_whole_wave(drive, whole):
    assert drive.changes_sign
    assert not whole.changes_sign
    assert whole.period == pytest.approx(2.0 * drive.period, rel=1e-15)
    at = times(drive)
    np.testing.assert_allclose(drive.value(at), whole.value(at), rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", [*BOTH, *WHOLE])
def test_switches_of_the_second_period_are_those_of_the_first(name):
    drive = BOTH[name] if name in BOTH else WHOLE[name][0]
    q, period = drive.parameters(), drive.period
    for voltage in channels(drive):
        for time in drive.switches:
            # Right-continuous in both periods, to the last bit.
            for at in (time, period + time) if drive.changes_sign else (time,):
                after = voltage(at, q)
                h = 1e-9 * period
                assert voltage(at + h, q) == pytest.approx(after, abs=1e-7)
                before = voltage(math.nextafter(at, 0.0), q)
                assert voltage(at - h, q) == pytest.approx(before, abs=1e-7)


@pytest.mark.parametrize("name", BOTH)
def test_waves_within_continue_with_their_sign(name):
    drive = BOTH[name]
    sides = [drive.wave] if isinstance(drive, mi.Burst) else [drive.right, drive.left]
    length = drive.length if isinstance(drive, mi.Burst) else 2.0 * drive.period
    at = np.array([time for time in times(drive) if time < length])
    for own, side in zip(sides, drive.sides, strict=True):
        expected = own.value(at)
        np.testing.assert_allclose(drive.value(at, channel=side), expected, rtol=0, atol=1e-12)


def test_who_changes_the_sign():
    found = {name: drive.changes_sign for name, drive in (DRIVES | BOTH).items()}
    changing = {name for name, changes in found.items() if changes}
    assert changing == {
        "sine", "mirrored square", "constant square", "trapezoid", "triangle", "two-sided sine",
        "custom", "one to one", "two to one", "three to two", "one side alone",
    }  # fmt: skip
    for name, drive in (DRIVES | BOTH).items():
        drive.check_signed()
        if name in changing:
            q, period, pairs = drive.parameters(), drive.period, channels(drive)
            pairs = [(a, b) for t in times(drive) for wave in pairs
                     for a, b in [(wave(t, q), wave(t + period, q))]]  # fmt: skip
            assert any(a == pytest.approx(-b, abs=1e-12) and abs(a) > 0.1 for a, b in pairs)


def test_own_functions():
    own = mi.Custom(function=cubed, period=math.pi / 0.5,
                    values={"top": 0.3, "omega": 0.5})  # fmt: skip
    assert own.changes_sign
    own.check_signed()
    assert not own.replace(period=2.0 * math.pi / 0.5).changes_sign


def alternating(t, q):
    u = t - 2.0 * math.floor(0.5 * t)
    return q[0] if u < 1.0 else -q[0] if u >= 1.0 else 0.0


def test_undeclared_jumps_of_the_sign_are_refused():
    drive = mi.Custom(function=alternating, period=1.0, values={"top": 0.3},
                      switches=[1.0])  # fmt: skip
    ZHAO.under(drive)
    assert not drive.changes_sign
    for each in (drive, mi.Burst(wave=drive, on=2.0, off=1.0)):
        with pytest.raises(mi.InvalidParameter, match="period of the voltage itself"):
            ZHAO.adding(Nothing()).under(each)
    ZHAO.adding(Nothing()).under(drive.replace(period=2.0, switches=[1.0, 2.0]))


RUNS = {"sine": SINE, "square": FLANKS, "one to one": BOTH["one to one"], "burst": BOTH["a burst"]}


@pytest.mark.quick(1)
@pytest.mark.parametrize("drive", RUNS.values(), ids=list(RUNS))
def test_two_forcing_periods_in_one(drive):
    factor = 2 if drive.changes_sign else 1
    first = {"initial": mi.State(v2=0.5), "options": INTERPRETED}
    paper = mi.simulate(ZHAO, drive, 2, window=(0, 2), **first)
    run = mi.simulate(ZHAO.adding(Nothing()), drive, 2 // factor, window=(0, 2 // factor), **first)
    assert run.system.forcing_period == pytest.approx(factor * drive.period, rel=1e-15)
    for name in ("x1", "v1", "x2", "v2"):
        ours, other = getattr(run.final, name), getattr(paper.final, name)
        assert ours == pytest.approx(other, abs=2e-9)
    assert len(run.impacts) == len(paper.impacts) > 0
    np.testing.assert_allclose(run.impacts["t"], paper.impacts["t"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(run.section()["t"], paper.section()["t"], rtol=0, atol=1e-8)
    fine, coarse = run.samples(8 * factor), paper.samples(8)
    np.testing.assert_allclose(fine["t"], coarse["t"], rtol=1e-14)
    np.testing.assert_allclose(fine["x2"], coarse["x2"], rtol=0, atol=2e-9)
    one, two = run.statistics, paper.statistics
    assert one["mean speed"] == pytest.approx(two["mean speed"], abs=1e-9)
    for name in ("displacement per period", "impacts per period", "energy lost per period"):
        assert one[name] == pytest.approx(factor * two[name], abs=1e-8)
