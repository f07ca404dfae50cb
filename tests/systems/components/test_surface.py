"""Switching surfaces: crossing, sliding after Filippov, leaving, all with exact solutions."""

from __future__ import annotations

import math

import pytest

import mems_impact as mi

PLAIN = mi.Options(engine="interpreted", method="dop853")


def ramp(mode, t, y, p):
    if mode.line > 0:
        return 1.0, -1.0
    return 3.0, 2.0 - y.x


def fold(parts):
    return mi.System(states=("x", "h"), flow=ramp, initial={"h": 0.5, "x": -0.5}, parts=parts)


def height(t, y, p):
    return y.h


def climbs(t, y, d, p):
    return d.h


@pytest.mark.parametrize(
    "line",
    [mi.SwitchingSurface("line", "h"), mi.SwitchingSurface("line", height, rate=climbs),
     mi.SwitchingSurface("line", {"h": 2.0, "x": 0.0})],
    ids=["state", "function", "sum"],
)  # fmt: skip
def test_a_state_slides_by_the_convex_method_and_leaves_at_the_fold(line):
    run = mi.simulate(fold([line]), duration=2.0, options=PLAIN)
    assert run.events["event"].tolist() == ["line", "line leaves down"]
    # It reaches the line at x = 0 and slides with x' = (5 - x)/(3 - x) until 2 - x is zero.
    reached = 0.5
    left = reached + 2.0 + 2.0 * math.log(3.0 / 5.0)
    assert run.events["t"].tolist() == pytest.approx([reached, left], rel=1e-9)
    assert run.events["x"].tolist() == pytest.approx([0.0, 2.0], abs=1e-9)
    x = 2.0 + 3.0 * (2.0 - left)
    assert run.final.x == pytest.approx(x, rel=1e-9)
    assert run.final.h == pytest.approx(-((x - 2.0) ** 2) / 6.0, rel=1e-8)
    assert run.final.mode == "below"


def test_a_state_crosses_where_the_flow_beyond_leads_away():
    run = mi.simulate(
        fold([mi.SwitchingSurface("line", "h")]), duration=1.0, initial={"x": 3.0}, options=PLAIN
    )
    assert run.events["mode after"].tolist() == ["below"]
    t = 0.5
    assert run.events["t"].tolist() == pytest.approx([t], rel=1e-12)
    # From x = 3.5: h' = 2 - x.
    assert run.final.h == pytest.approx(-1.5 * t - 1.5 * t * t, rel=1e-9)


def test_dry_friction_as_a_surface_is_dry_friction():
    def flow(mode, t, y, p):
        return y.v, -y.x + 2.0 * math.cos(p.omega * t) - 0.7 * mode.contact

    shared = {"states": ("x", "v"), "period": lambda p: 2.0 * math.pi / p.omega,
              "parameters": {"omega": 0.4}, "initial": {"x": 0.3, "v": 0.2}}  # fmt: skip
    slides = mi.System(flow=flow, parts=[mi.SwitchingSurface("contact", "v")], **shared)
    sticks = mi.System(
        flow=lambda mode, t, y, p: (y.v, -y.x + 2.0 * math.cos(p.omega * t)),
        parts=[mi.Friction("contact", "v", mu=0.7)],
        **shared,
    )
    one, other = (mi.simulate(each, 6, options=PLAIN) for each in (slides, sticks))
    assert (one.events["mode after"] == "sliding").sum() >= 6
    # Utkin's equivalent control is the force of the contact that sticks.
    assert one.events["t"].to_numpy() == pytest.approx(other.events["t"].to_numpy(), abs=1e-7)
    assert one.final.x == pytest.approx(other.final.x, abs=1e-7)


def test_where_both_flows_lead_away_the_state_stays_on_its_side():
    apart = mi.System(
        states=("h",), flow=lambda mode, t, y, p: (1.0 * mode.line,), initial={"h": -1e-3},
        parts=[mi.SwitchingSurface("line", "h")],
    )  # fmt: skip
    below = mi.simulate(apart, duration=1.0, options=PLAIN)
    assert below.final.mode == "below"
    assert below.final.h == pytest.approx(-1.001, rel=1e-12)
    assert mi.simulate(apart, duration=1.0, initial={"h": 0.0}, options=PLAIN).final.h > 0.9


def test_a_surface_that_moves_with_a_parameter_and_a_level():
    run = mi.simulate(
        mi.System(
            states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.u * mode.line),
            parameters={"u": 1.0, "c": 2.0, "goal": 1.0}, initial={"x": 3.0},
            parts=[mi.SwitchingSurface("line", {"x": "c", "v": 1.0}, level=lambda p: p.c * p.goal)],
        ),
        duration=8.0,
        options=PLAIN,
    )  # fmt: skip
    # On c (x - goal) + v = 0 the distance to the goal falls as exp(-c t).
    assert run.final.mode == "sliding"
    entered = run.events.iloc[-1]
    gone = 8.0 - entered["t"]
    assert run.final.x - 1.0 == pytest.approx(
        (entered["x"] - 1.0) * math.exp(-2.0 * gone), rel=1e-6
    )


def test_two_surfaces_that_attract_at_once_are_an_error_and_else_each_has_its_own():
    def flow(mode, t, y, p):
        return -1.0 * mode.first, p.drift - 1.0 * mode.second

    corner = mi.System(
        states=("x", "z"), flow=flow, parameters={"drift": 0.0}, initial={"x": 1.0, "z": 2.0},
        parts=[mi.SwitchingSurface("first", "x"), mi.SwitchingSurface("second", "z")],
    )  # fmt: skip
    with pytest.raises(mi.RunError, match="two switching surfaces attract the state at once"):
        mi.simulate(corner, duration=3.0, options=PLAIN)
    crossed = mi.simulate(corner.changed(drift=-3.0), duration=3.0, options=PLAIN)
    assert crossed.events["event"].tolist() == ["second", "first"]
    assert crossed.events["t"].tolist() == pytest.approx([0.5, 1.0], rel=1e-12)
    assert crossed.final.mode == "sliding-below"
    assert crossed.final.z == pytest.approx(2.0 - 0.5 * 4.0 - 2.5 * 2.0, rel=1e-9)


def test_a_body_with_friction_slides_along_the_line_that_its_control_holds():
    def control(mode, t, y, p):
        return y.v, -2.0 * mode.line

    held = mi.System(
        states=("x", "v"), flow=control, initial={"x": 2.0},
        parts=[
            mi.SwitchingSurface("line", {"x": 1.0, "v": 1.0}), mi.Friction("ground", "v", mu=0.3)
        ],
    )  # fmt: skip
    run = mi.simulate(held, duration=4.0, options=PLAIN)
    # Until it is reached v = -1.7 t and x = 2 - 0.85 t^2; then x falls as exp(-t).
    t = -1.0 + math.sqrt(1.0 + 2.0 / 0.85)
    assert run.events["t"].tolist() == pytest.approx([t], rel=1e-9)
    assert run.final.mode == "sliding-backward"
    assert run.final.x == pytest.approx(1.7 * t * math.exp(t - 4.0), rel=1e-8)
