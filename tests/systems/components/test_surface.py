"""Switching surfaces: crossing, sliding after Filippov, leaving, all with exact solutions."""

from __future__ import annotations

import math
import re

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


@pytest.mark.parametrize(
    "line",
    [mi.SwitchingSurface("line", "h"), mi.SwitchingSurface("line", height),
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


def test_rates_of_a_state_at_rest_on_a_surface_are_no_jumps(recwarn):
    """They are rounding errors of fields of order one, in every period others."""

    def flow(mode, t, y, p):
        return 0.7 * math.cos(t - 1.0) - 1.1 * mode.line, y.x - 0.2 * y.z

    still = mi.System(
        states=("x", "z"), flow=flow, period=2.0 * math.pi, parts=[mi.SwitchingSurface("line", "x")]
    )
    run = mi.simulate(still, periods=30, options=PLAIN)
    assert (run.final.x, run.final.z) == pytest.approx((0.0, 0.0), abs=1e-13)
    assert not [each for each in recwarn if each.category is mi.DiscontinuityWarning]


def signs(x_drift, x_gains, y_drift, y_gains):
    """Return the flow x' = x_drift - x_gains (sgn x, sgn y), y' alike, z' = 1."""

    def flow(mode, t, y, p):
        return (
            x_drift - x_gains[0] * mode.sx - x_gains[1] * mode.sy,
            y_drift - y_gains[0] * mode.sx - y_gains[1] * mode.sy,
            1.0,
        )

    return flow


def crossing(flow, initial):
    return mi.System(
        states=("x", "y", "z"), flow=flow, initial=initial,
        parts=[mi.SwitchingSurface("sx", "x"), mi.SwitchingSurface("sy", "y")],
    )  # fmt: skip


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("flow", "initial", "times"),
    [
        (signs(0.5, (2.0, 0.0), 1.0, (0.0, 3.0)), {"x": 1.0, "y": 1.0}, [0.5, 2.0 / 3.0]),
        # It slides along y = 0 with x' = -1.25 from x = 0.9.
        (signs(0.0, (1.0, -0.5), 0.0, (0.5, 1.0)), {"x": 1.0, "y": 0.3}, [0.2, 0.92]),
    ],
    ids=["decoupled", "coupled"],
)
def test_a_state_slides_on_the_intersection_of_two_surfaces(flow, initial, times):
    run = mi.simulate(crossing(flow, initial), duration=3.0, options=PLAIN)
    assert run.events["t"].tolist() == pytest.approx(times, rel=1e-9)
    assert run.final.mode == "sliding-sliding"
    assert (run.final.x, run.final.y, run.final.z) == pytest.approx((0.0, 0.0, 3.0), abs=1e-9)


def test_a_spiral_into_a_crossing_ends_there():
    # A half turn from (x, 0) with the rates (3, 1), (1, 3) shortens the distance by the factor 9.
    flow = signs(0.0, (1.0, -2.0), 0.0, (2.0, 1.0))
    run = mi.simulate(crossing(flow, {"x": 1.0, "y": 0.3}), duration=2.0, options=PLAIN)
    first = 0.1  # y = 0 at x = 1.1; then x' = -3, and y' = -1 until x = 0, and so on
    end = first + 1.1 * (1.0 / 3.0 + 1.0 / 9.0) / (1.0 - 1.0 / 9.0)
    assert run.events["t"].iloc[-1] == pytest.approx(end, abs=1e-10)
    assert run.final.mode == "sliding-sliding"


def test_a_state_leaves_an_intersection_where_one_surface_lets_it_go():
    def flow(mode, t, y, p):
        return y.z - mode.sx + 0.2 * mode.sy, -0.5 * y.z - mode.sy, 1.0

    run = mi.simulate(crossing(flow, {"x": 0.3, "y": 0.2}), duration=4.0, options=PLAIN)
    # On y = 0 the mean of sgn y is -z/2, so x' = 0.9 z - sgn x, which is positive from z = 10/9;
    # y' = -z/2 - sgn y falls below zero at z = 2, when x = 0.45 z^2 - z + 5/9.
    assert run.events["event"].tolist()[-2:] == ["sx leaves up", "sy leaves down"]
    assert run.events["t"].tolist()[-2:] == pytest.approx([10.0 / 9.0, 2.0], rel=1e-9)
    x = 0.45 * 4.0 - 2.0 + 5.0 / 9.0 + 6.0 - 1.2 * 2.0
    assert (run.final.x, run.final.y) == pytest.approx((x, -1.0), rel=1e-8)


@pytest.mark.slow
def test_a_motion_that_is_not_unique_is_an_error_with_two_of_them():
    def product(mode, t, y, p):
        return -1.0 * mode.sx, -1.0 * mode.sy, 1.0 * mode.sx * mode.sy

    system = crossing(product, {"x": 1.0, "y": 0.3})
    with pytest.raises(mi.RunError, match=r"not unique.* z' = -1 or .* z' = 1 "):
        mi.simulate(system, duration=2.0, options=PLAIN)

    def fork(mode, t, y, p):  # along x = 0 until y = 0, from where x = 0 repels
        return -1.0 * mode.sx * mode.sy, -1.0, 0.0

    with pytest.raises(mi.RunError, match=r"not unique.*'above-below'.*'below-below'"):
        mi.simulate(crossing(fork, {"x": 0.1, "y": 0.3}), duration=2.0, options=PLAIN)


@pytest.mark.parametrize(
    "other", [{"x": -2.0, "y": 2.0}, {"x": "minus", "y": 1.0}], ids=["at once", "in a run"]
)
def test_surfaces_that_coincide_are_refused(other):
    def flow(mode, t, y, p):
        return -2.0 if mode.a == 1 else 2.0, -3.0 if mode.b == 1 else 1.5

    parts = [mi.SwitchingSurface("a", {"x": 1.0, "y": -1.0}), mi.SwitchingSurface("b", other)]
    with pytest.raises(mi.MemsImpactError, match=r"'a'.*'b'"):
        mi.simulate(
            mi.System(states=("x", "y"), flow=flow, initial={"x": 1.5, "y": 1.0}, parts=parts,
                      parameters={"minus": -1.0}),
            duration=1.0,
            options=PLAIN,
        )  # fmt: skip


def test_a_start_on_a_surface_that_repels_is_warned_of():
    apart = mi.System(
        states=("h",), flow=lambda mode, t, y, p: (1.0 * mode.line,), initial={"h": 1.0},
        parts=[mi.SwitchingSurface("line", "h")],
    )  # fmt: skip
    with pytest.warns(mi.StartWarning, match=r"not unique.*'above'.*'below'"):
        mi.simulate(apart, duration=1.0, initial={"h": 0.0}, options=PLAIN)


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


@pytest.mark.slow
@pytest.mark.parametrize(("a", "b", "meets"), [(1.6, 1.3, False), (1.05, 1.1, True)])
def test_an_orbit_slides_on_two_surfaces_for_parts_of_its_period(a, b, meets):
    def flow(mode, t, y, p):
        return p.a * math.cos(t) - mode.sx, p.b * math.sin(t + 0.4) - mode.sy, y.x - 0.3 * y.z

    system = mi.System(
        states=("x", "y", "z"), flow=flow, period=2.0 * math.pi, parameters={"a": a, "b": b},
        parts=[mi.SwitchingSurface("sx", "x"), mi.SwitchingSurface("sy", "y")],
    )  # fmt: skip
    orbit = mi.find_orbit(mi.simulate(system, periods=40, options=PLAIN), options=PLAIN)
    events = orbit.events.set_index("event")
    # The flow of one side is tangent where the cosine and the sine have the size of the jump.
    left = [math.acos(-1.0 / a), 2.0 * math.pi - math.acos(1.0 / a)]
    assert events["t"]["sx leaves down"] == pytest.approx(left[0], abs=1e-9)
    assert events["t"]["sx leaves up"] == pytest.approx(left[1], abs=1e-9)
    assert events["t"]["sy leaves up"] == pytest.approx(math.asin(1.0 / b) - 0.4, abs=1e-9)
    assert ("sliding-sliding" in set(events["mode after"])) == meets
    assert sorted(abs(orbit.multipliers)) == pytest.approx(
        [0.0, 0.0, math.exp(-0.6 * math.pi)], abs=1e-9
    )


@pytest.mark.slow
def test_equilibria_on_an_intersection_have_the_eigenvalues_of_the_motion_along_it():
    def flow(mode, t, y, p):
        return (
            0.5 - 2.0 * mode.sx + 0.1 * y.w,
            1.0 - 3.0 * mode.sy + 0.1 * y.z,
            p.u - 0.7 * y.z + y.w + 0.4 * mode.sx,
            0.2 * mode.sy - 0.5 * y.w - y.z * y.z,
        )

    system = mi.System(
        states=("x", "y", "z", "w"), flow=flow, parameters={"u": 0.3},
        parts=[mi.SwitchingSurface("sx", "x"), mi.SwitchingSurface("sy", "y")],
    )  # fmt: skip
    (rest,) = mi.find_equilibria(system, modes=["sliding-sliding"])
    z, w = rest.state.z, rest.state.w
    # With the means (0.5 + 0.1 w)/2 and (1 + 0.1 z)/3 of the signs.
    assert 0.4 - 0.7 * z + 1.02 * w == pytest.approx(0.0, abs=1e-9)
    assert 0.2 / 3.0 + 0.02 / 3.0 * z - 0.5 * w - z * z == pytest.approx(0.0, abs=1e-9)
    fold = mi.continue_solution(rest, "u", stop=-1.0).special_points[0]
    trace, product = -1.2, 0.35 + 1.02 * (2.0 * z - 0.02 / 3.0)
    assert sum(rest.eigenvalues) == pytest.approx(trace, abs=1e-9)
    assert math.prod(rest.eigenvalues) == pytest.approx(product, abs=1e-9)
    z = 0.5 * (0.02 / 3.0 - 0.35 / 1.02)  # where the product is zero
    w = 2.0 * (0.2 / 3.0 + 0.02 / 3.0 * z - z * z)
    assert fold.label == "LP"
    assert fold.value == pytest.approx(0.7 * z - 1.02 * w - 0.1, abs=1e-9)


def repelled(mode, t, y, p):
    return (y.z - 1.0) * mode.sx, -1.0 * mode.sy, 1.0


def fused(mode, t, y, p):  # where z > 1/2, each axis may leave as long as the other does not
    brake = 0.8 * max(0.0, y.z - 0.5)
    return (
        y.z - mode.sx - brake * (1.0 + mode.sy),
        y.z - mode.sy - brake * (1.0 + mode.sx),
        1.0,
    )


def expanding(mode, t, y, p):  # a spiral that contracts where z < 1
    return 2.0 * mode.sy - (1.0 - y.z) * mode.sx, -2.0 * mode.sx - (1.0 - y.z) * mode.sy, 1.0


def branching(mode, t, y, p):  # from z = 1 the velocity along z depends on the mean of a product
    return -1.0 * mode.sx, -1.0 * mode.sy, 1.0 + max(0.0, y.z - 1.0) * mode.sx * mode.sy


def retained(mode, t, y, p):  # at z = 1 only the flow of x > 0 > y lets a state go
    return (
        0.35 - 2.6 * mode.sx - 2.75 * mode.sy,
        -0.975 + 0.5 * (1.0 - y.z) + 1.5 * mode.sx + 0.525 * mode.sy,
        1.0,
    )


@pytest.mark.slow(all=True)
@pytest.mark.parametrize(
    ("flow", "end", "motions"),
    [
        (repelled, 1.0, ("above-sliding", "below-sliding")),
        (fused, 1.75, ("sliding-above", "above-sliding")),
        (expanding, 1.0, ("sliding-sliding", "above-above")),
        (branching, 1.0, ("sliding-sliding", "sliding-sliding")),
        # The means (0.9, -0.7) of the signs may hold it longer.
        (retained, 1.0, ("sliding-sliding", "above-below")),
    ],
)
def test_sliding_that_ceases_to_be_unique_is_an_error_with_two_motions(flow, end, motions):
    one, other = motions
    with pytest.raises(mi.RunError, match=rf"not unique.*'{one}'.*'{other}'") as error:
        mi.simulate(crossing(flow, {"x": 0.3, "y": 0.2, "z": -1.0}), duration=6.0, options=PLAIN)
    assert error.value.state["z"] == pytest.approx(end, abs=1e-6)


def meeting(flow, initial):
    """Return a system with the surfaces x = 0, y = 0 and w = 0, and time z."""
    parts = [mi.SwitchingSurface(name, state) for name, state in zip("abc", "xyw", strict=True)]
    return mi.System(states=("x", "y", "w", "z"), flow=flow, initial=initial, parts=parts)


def expanding_beside(mode, t, y, p):
    return (
        3.0 * mode.b - (1.5 - y.z) * mode.a,
        -3.0 * mode.a - (1.5 - y.z) * mode.b,
        0.4 - 1.0 * mode.c,
        1.0,
    )


def retained_beside(mode, t, y, p):  # w is held apart; of x and y one region lets go at z = 1
    return (
        0.3 - 2.5 * mode.a - 2.75 * mode.b,
        -1.0 + 0.5 * (1.0 - y.z) + 1.5 * mode.a + 0.5 * mode.b,
        0.3 - mode.c,
        1.0,
    )


@pytest.mark.slow(all=True)
@pytest.mark.parametrize(
    ("flow", "end", "other"),
    [
        (expanding_beside, 1.5, "above-above-sliding"),
        (retained_beside, 1.0, "above-below-sliding"),
    ],
)
def test_sliding_on_three_surfaces_that_ceases_to_be_unique_is_an_error(flow, end, other):
    system = meeting(flow, {"x": 0.3, "y": 0.2, "w": 0.1, "z": -1.0})
    found = rf"not unique.*'sliding-sliding-sliding'.*'{other}'"
    with pytest.raises(mi.RunError, match=found) as error:
        mi.simulate(system, duration=4.0, options=PLAIN)
    assert error.value.state["z"] == pytest.approx(end, abs=1e-6)


@pytest.mark.slow
def test_motions_around_three_surfaces_that_may_expand_are_warned_of():
    def flow(mode, t, y, p):  # from z = 1/2 octants follow each other, farther and farther away
        hold, pull, push = (1.0, 0.2, 0.1) if y.z < 0.5 else (0.1, 1.0, 2.0)
        return (
            pull * mode.b - push * mode.c - hold * mode.a,
            pull * mode.c - push * mode.a - hold * mode.b,
            pull * mode.a - push * mode.b - hold * mode.c,
            1.0,
        )

    system = meeting(flow, {"x": 0.1, "y": 0.1, "w": 0.05})
    with pytest.warns(mi.StartWarning, match=r"a, b, c.* at t = 1, may expand"):
        run = mi.simulate(system, duration=1.0, options=PLAIN)
    assert run.final.mode == "sliding-sliding-sliding"
    beside = mi.simulate(system, duration=1.0, initial={"w": 1e-3, "z": 0.5}, options=PLAIN)
    assert max(abs(beside.final.x), abs(beside.final.y), abs(beside.final.w)) > 0.1


@pytest.mark.parametrize(
    ("x", "y", "held"), [(0.3, 0.2, True), (0.0, 0.35, True), (-0.3, 0.2, False)]
)
def test_an_arrival_at_an_intersection_that_can_hold_the_state(x, y, held):
    """The region of x > 0 > y lets the state go.

    Signs smoothed by tanh hold it if they are equally wide, and let it go if the sign of y is
    smoothed ten times more sharply.
    """

    def flow(mode, t, y, p):
        return (
            0.35 - 2.6 * mode.sx - 2.75 * mode.sy, -1.0 + 1.5 * mode.sx + 0.525 * mode.sy, 1.0
        )  # fmt: skip

    system = crossing(flow, {"x": x, "y": y})
    if held:
        with pytest.raises(mi.RunError, match=r"not unique.*'sliding-sliding'.*'above-below'"):
            mi.simulate(system, duration=3.0, options=PLAIN)
        return
    run = mi.simulate(system, duration=3.0, options=PLAIN)
    # Down y = 0 at t = 0.2/1.975 and x = 0, each beside the intersection.
    first = 0.2 / 1.975
    second = first + (0.3 - 0.2 * first) / 5.7
    assert run.final.mode == "above-below"
    assert run.final.x == pytest.approx(0.5 * (3.0 - second), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_sliding_ends_where_the_rates_of_all_flows_around_an_intersection_are_parallel(method):
    def flow(mode, t, y, p):  # the signs have the means 0.3 and -0.4 until z = 1
        a, b = mode.sx - 0.3, mode.sy + 0.4
        return -2.0 * a - b, -2.0 * a - (2.0 - y.z) * b, 1.0 + 10.0 * max(0.0, y.z) * a

    system = crossing(flow, {"x": 0.3, "y": 0.2, "z": -1.0})
    options = mi.Options(method=method, rtol=1e-10, atol=1e-12)
    with pytest.raises(mi.RunError, match="not unique") as error:
        mi.simulate(system, duration=6.0, options=options)
    # Rates are parallel within 1e-7 of their sizes.
    assert error.value.state["z"] == pytest.approx(1.0, abs=2e-6)
    low, high = (float(each) for each in re.findall(r"z' = ([-.\d]+)", str(error.value)))
    # Between (-0.4, 1) and (0.6, -1), the means with 2 a + b = 0.
    assert (low, high) == pytest.approx((-6.0, 4.0), rel=1e-5)


def test_a_motion_that_slides_into_a_two_fold_is_not_unique_from_there():
    # Both flows are tangent at y = z = 0, a node of the sliding flow y' = z - 2 y, z' = y - 2 z
    # but for a positive factor.
    def flow(mode, t, y, p):
        return (-y.y, 1.0, -2.0) if mode.line > 0 else (y.z, -2.0, 1.0)

    node = mi.System(
        states=("x", "y", "z"), flow=flow, initial={"x": 0.01, "y": 0.8, "z": 1.7},
        parts=[mi.SwitchingSurface("line", "x")],
    )  # fmt: skip
    with pytest.raises(mi.RunError, match=r"not unique.*'below'.*'above'"):
        mi.simulate(node, duration=9.0, options=PLAIN)


def test_equal_axes_leave_an_intersection_together():
    def flow(mode, t, y, p):
        return y.z - mode.sx, y.z - mode.sy, 1.0

    run = mi.simulate(crossing(flow, {"x": 0.5, "y": 0.3}), duration=4.0, options=PLAIN)
    # From z = 1 both grow with z - 1.
    assert (run.final.x, run.final.y) == pytest.approx((4.5, 4.5), rel=1e-9)


def unit_circle(t, y, p):
    return y.x * y.x + y.y * y.y - 1.0


@pytest.mark.slow
def test_a_state_slides_on_a_circle_and_on_its_intersections():
    wall = mi.SwitchingSurface("wall", unit_circle)

    def flow(mode, t, y, p):  # the mean of the sign of the wall is 0.3 on it
        radial = 0.3 - mode.wall
        return y.y + radial * y.x, radial * y.y - y.x, -2.0 * mode.sz + mode.wall

    system = mi.System(
        states=("x", "y", "z"), flow=flow, initial={"x": 0.5, "z": 0.4},
        parts=[wall, mi.SwitchingSurface("sz", "z")],
    )  # fmt: skip
    run = mi.simulate(system, duration=5.0, options=PLAIN)
    # Inside r' = 1.3 r and z' = -3 until z = 0, where the mean of its sign is -1/2, later 0.15.
    assert run.events["t"].tolist() == pytest.approx([0.4 / 3.0, math.log(2.0) / 1.3], rel=1e-9)
    assert run.final.mode == "sliding-sliding"
    assert (run.final.x, run.final.y) == pytest.approx((math.cos(5.0), -math.sin(5.0)), abs=1e-9)


@pytest.mark.slow
def test_three_surfaces_through_a_line_hold_a_state_there():
    def flow(mode, t, y, p):
        push = 0.3 - mode.a - 0.5 * mode.c, -0.2 - mode.b - 0.4 * mode.c
        return *push, 1.0 + 2.0 * push[0]

    parts = [mi.SwitchingSurface("a", "x"), mi.SwitchingSurface("b", "y"),
             mi.SwitchingSurface("c", {"x": 1.0, "y": 1.0})]  # fmt: skip
    system = mi.System(states=("x", "y", "z"), flow=flow, initial={"x": 1.0, "y": 0.7}, parts=parts)
    run = mi.simulate(system, duration=4.0, options=PLAIN)
    assert run.final.mode == "sliding-sliding-sliding"
    # The line holds x, and z - 2 x grows with one.
    assert (run.final.x, run.final.y) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert run.final.z == pytest.approx(4.0 + 2.0 * (0.0 - 1.0), rel=1e-9)
