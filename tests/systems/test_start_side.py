"""A start beyond the margin of a plain guard, as far as it can be told."""

from __future__ import annotations

import warnings

import pytest

import mems_impact as mi

PLAIN = mi.Options(engine="interpreted", method="dop853")


def fall(mode, t, y, p):
    return y.v, -1.0


def ball(margin, transition=lambda mode, t, y, p: (mode, (0.0, -0.5 * y.v)), **more):
    floor = mi.Guard("floor", margin, transition)
    given = {"flow": fall, "initial": {"x": 1.0}, **more}
    return mi.System(states=("x", "v"), guards=[floor], **given)


def quiet(system, **arguments):
    with warnings.catch_warnings():
        warnings.simplefilter("error", mi.StartWarning)
        return mi.simulate(system, duration=0.5, options=PLAIN, **arguments)


@pytest.mark.parametrize("speed", [0.0, 1.0, -1.0])
def test_a_margin_with_the_wrong_sign_is_reported_before_it_moves_a_body(speed):
    wrong = ball(lambda mode, t, y, p: -y.x)
    message = r"the margin of 'floor' is negative at .* changes x from 1 to 0.*reverse the sign"
    with pytest.warns(mi.StartWarning, match=message) as caught:
        mi.simulate(wrong, duration=0.1, initial=mi.State(x=1.0, v=speed), options=PLAIN)
    assert caught[0].filename == __file__


def test_a_device_in_its_own_units_is_reported_in_them():
    wrong = ball(
        lambda mode, t, y, p: -y.x,
        flow=lambda mode, t, y, p: (y.v, -9.81),
        initial={"x": 2e-6},
        typical={"x": 1e-6, "v": 1e-3, "time": 1e-3},
        units={"x": "m", "v": "m/s", "time": "s"},
    )
    with pytest.warns(mi.StartWarning, match=r"changes x \[m\] from 2e-06 to 0;"):
        mi.simulate(wrong, duration=1e-4, options=PLAIN)


def test_what_may_start_there_is_not_reported():
    right = ball(lambda mode, t, y, p: y.x)
    quiet(right)
    # On the floor, leaving it, and below it by rounding.
    for start in ({"x": 0.0, "v": 1.0}, {"x": -1e-15, "v": 1.0}):
        quiet(right, initial=start)
    # What changes the mode alone switches at once, as a relay does that starts beyond a threshold.
    COLD, WARM = mi.modes("cold", "warm")
    heats = mi.Guard("heats", lambda m, t, y, p: y.T - 1.0, lambda m, t, y, p: (WARM, (y.T,)),
                     modes=(COLD,))  # fmt: skip
    cools = mi.Guard("cools", lambda m, t, y, p: 2.0 - y.T, lambda m, t, y, p: (COLD, (y.T,)),
                     modes=(WARM,))  # fmt: skip
    room = mi.System(
        states=("T",), modes=(COLD, WARM), guards=[heats, cools], time_scale=1.0,
        flow=lambda mode, t, y, p: (-y.T if mode == COLD else 3.0 - y.T,), initial={"T": 0.5},
    )  # fmt: skip
    assert quiet(room).events["event"].tolist() == ["heats"]
    # A guard that only records, one that ends the run, and one of another mode.
    quiet(ball(lambda mode, t, y, p: -y.x, None))
    quiet(right, until=lambda mode, t, y, p: y.x - 2.0)
    other = mi.Guard(
        "other", lambda m, t, y, p: -1.0, lambda m, t, y, p: (m, (5.0,)), modes=(WARM,)
    )
    quiet(mi.System(states=("T",), modes=(COLD, WARM), guards=[other], time_scale=1.0,
                    flow=lambda mode, t, y, p: (-y.T,), initial={"T": 0.5}))  # fmt: skip
