"""Onset of complete chatter of a ball on a table that shakes it, against flights in closed form.

The ball leaves the table where A sin(theta) = 1, rising. Near the next such instant the closing
acceleration falls in proportion to the time tau that is left, and what counts is q = u / (k tau^2)
with the speed u after an impact: small q means rest before the release, large q none.
"""

import math
from functools import cache, partial

import pytest
from scipy.optimize import brentq

import mems_impact as mi

FALLS_TO_REST, NEVER_RESTS = 0.02, 1.0 / 3.0


def _cubic(T):
    """Return T - sin T, to all digits where T is small."""
    if T > 0.3:
        return T - math.sin(T)
    total, term, k = 0.0, T**3 / 6.0, 3
    while term != 0.0 and abs(term) > 1e-18 * abs(total):
        total += term
        term *= -T * T / ((k + 1) * (k + 2))
        k += 2
    return total


def _height(T, u, A, theta):
    half = math.sin(0.5 * T)
    return u * T - 0.5 * T * T + A * (2.0 * math.sin(theta) * half**2 + math.cos(theta) * _cubic(T))


def _speed(T, u, A, theta):
    half = math.sin(0.5 * T)
    return u - T + A * (math.sin(theta) * math.sin(T) + 2.0 * math.cos(theta) * half**2)


def _comes_to_rest(A, e):
    """Return whether the impacts after a release accumulate before the next one."""
    release, k = math.asin(1.0 / A), math.sqrt(A * A - 1.0)
    t, u = 0.0, 0.0
    while True:
        pull = 1.0 - A * math.sin(release + t)
        h = 0.02 if u == 0.0 else min(0.05, 0.25 * u / abs(pull))
        height = partial(_height, u=u, A=A, theta=release + t)
        T = h
        while height(T) > 0.0:
            T += h
        flight = brentq(lambda s, height=height: height(s) / s, T - h or 0.1 * h, T, xtol=1e-300)
        u, t = -e * _speed(flight, u, A, release + t), t + flight
        left = 2.0 * math.pi - t
        if left <= 0.0 or u > NEVER_RESTS * k * left * left:
            return False
        if u < FALLS_TO_REST * k * left * left:
            return True


@cache
def _onset(e, low, high):
    assert _comes_to_rest(low, e)
    assert not _comes_to_rest(high, e)
    while True:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            return middle
        low, high = (middle, high) if _comes_to_rest(middle, e) else (low, middle)


def _fall(mode, t, y, p):
    return y.v, p.g * (p.A * math.sin(p.rate * t + p.phase) - 1.0)


def _ball(A, e, phase=2.5, unit=1.0, rate=1.0):
    g = unit * rate**2
    return mi.System(
        states=("x", "v"),
        flow=_fall,
        parameters={"A": A, "g": g, "rate": rate, "phase": phase, "e": e},
        period=2.0 * math.pi / rate,
        parts=[mi.Stopper("table", "x", "v", lower=0.0, restitution="e")],
        typical={"x": unit, "v": unit * rate, "g": g, "rate": rate},
    )


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("e", "start", "unit", "rate"),
    [(0.5, 1.597, 1.0, 1.0), (0.5, 1.597, 1e-6, 1e3), (0.4, 1.7565, 1.0, 1.0)],
    ids=str,
)
def test_branch_ends_at_the_onset_of_complete_chatter(e, start, unit, rate):
    expected = _onset(e, start, start + 0.02)
    orbit = mi.find_orbit(_ball(start, e, unit=unit, rate=rate), transient=20)
    branch = mi.continue_solution(orbit, "A", stop=start + 0.2)
    (onset,) = branch.special_points
    assert (onset.label, onset.kind) == ("CC", "onset of complete chatter")
    assert onset.value == pytest.approx(expected, abs=1e-9)
    assert branch.ended.startswith("onset of complete chatter: beyond it the contact releases")
    assert onset.orbit.admissible
    assert max(branch.table["A"]) == onset.value


@pytest.mark.nightly
def test_chatter_that_comes_to_the_start_of_a_period_is_no_grazing():
    """At this phase the period begins within the rest; the end of the chatter comes to meet it."""
    orbit = mi.find_orbit(_ball(1.55, 0.5, phase=0.0), transient=20)
    branch = mi.continue_solution(orbit, "A", stop=1.6)
    assert not branch.special_points
    assert branch.ended.startswith("a chatter sequence reaches the start")
    assert branch.table["admissible"].all()
    assert _comes_to_rest(max(branch.table["A"]), 0.5)


@pytest.mark.nightly
def test_the_onset_is_continued_in_two_parameters():
    """The number of impacts that the orbit holds stays, which costs the points some digits."""
    orbit = mi.find_orbit(_ball(1.597, 0.5), transient=20)
    (onset,) = mi.continue_solution(orbit, "A", stop=1.65).special_points
    curve = mi.continue_curve(onset, "e", 0.49)
    assert curve.ended == "e reached its bound"
    for A, e in curve.table[["A", "e"]].iloc[::3].to_numpy():
        assert pytest.approx(_onset(e, A - 0.01, A + 0.01), abs=1e-6) == A
