"""Curves of special points of equilibria in two parameters, and their points of codimension two.

All are in closed form. Kuznetsov, Elements of Applied Bifurcation Theory (2004), chapter 8, has the
normal forms.
"""

import math

import pytest

import mems_impact as mi

STEPS = mi.StepControl(initial_step=0.02, max_step=0.3)


def special_point(system, guess, parameter, stop, label, **bounds):
    first = mi.find_equilibria(system, guess=guess)[0]
    branch = mi.continue_solution(first, parameter, stop, **bounds)
    return next(each for each in branch.special_points if each.label == label)


def check(curve, *expected, tolerance=1e-9):
    for point, (kind, values) in zip(curve.special_points, expected, strict=True):
        assert point.kind == kind
        assert point.values == pytest.approx(values, abs=tolerance)


def cusp_flow(mode, t, y, p):
    return (p.a + p.b * y.x - y.x**3,)


def test_cusp():
    """Folds of a + b x - x^3 lie on 27 a^2 = 4 b^3."""
    system = mi.System(states=("x",), flow=cusp_flow, parameters={"a": -1.0, "b": 1.0})
    fold = special_point(system, {"x": -1.2}, "a", 1.0, "LP", back=-1.0)
    curve = mi.continue_curve(fold, "b", -1.0, back=1.5, steps=STEPS)
    check(curve, ("cusp", {"a": 0.0, "b": 0.0}))
    a, b = curve.table["a"].to_numpy(), curve.table["b"].to_numpy()
    assert abs(27.0 * a**2 - 4.0 * b**3).max() < 1e-9
    assert a[0] * a[-1] < 0.0  # on the other side of the cusp
    assert curve.ended == "b reached its bound"
    assert (curve.kind, curve.label, hasattr(curve, "orbits")) == ("fold", "LP", False)
    assert "equilibria" in repr(curve)


def takens(mode, t, y, p):
    return y.y, p.a + p.b * y.x + y.x**2 - y.x * y.y


TAKENS = mi.System(states=("x", "y"), flow=takens, parameters={"a": -1.0, "b": -1.0})


@pytest.mark.slow
def test_curves_of_folds_and_hopf_points_meet_at_bogdanov_takens():
    """Folds where 4 a = b^2, Hopf points where a = 0 and b < 0."""
    fold = special_point(TAKENS, {"x": -0.6}, "a", 1.0, "LP", back=-1.0)
    curve = mi.continue_curve(fold, "b", 1.0, steps=STEPS)
    check(curve, ("Bogdanov-Takens", {"a": 0.0, "b": 0.0}))
    assert abs(4.0 * curve.table["a"] - curve.table["b"] ** 2).max() < 1e-10

    hopf = special_point(TAKENS, {"x": -0.6}, "a", 1.0, "H", back=-1.0)
    curve = mi.continue_curve(hopf, "b", 1.0, steps=STEPS)
    check(curve, ("Bogdanov-Takens", {"a": 0.0, "b": 0.0}))
    assert curve.ended.startswith("Bogdanov-Takens: beyond it")
    assert "neutral saddle" in curve.ended
    assert abs(curve.table["a"]).max() < 1e-10
    assert abs(curve.special_points[0].equilibrium.eigenvalues).max() < 1e-4
    with pytest.raises(AttributeError, match="equilibrium"):
        curve.special_points[0].orbit  # noqa: B018


def quadratic(mode, t, y, p):
    return y.y, -y.x + p.m * y.y + 0.7 * y.x**2 + 0.4 * y.x * y.y + p.c * y.x**2 * y.y


def summed(mode, t, y, p):
    """Return the same flow by a function that does not take numbers with tangents."""
    terms = -y.x, p.m * y.y, 0.7 * y.x**2, 0.4 * y.x * y.y, p.c * y.x**2 * y.y
    return y.y, math.fsum(terms)


@pytest.mark.slow
@pytest.mark.parametrize("flow", [quadratic, summed], ids=["exact", "differences"])
def test_bautin(flow):
    """The first Lyapunov coefficient is (c + 0.7 * 0.4)/8 (Guckenheimer and Holmes, 3.4.11)."""
    system = mi.System(states=("x", "y"), flow=flow, parameters={"m": -0.5, "c": -1.0})
    hopf = special_point(system, {"x": 0.0}, "m", 0.5, "H")
    curve = mi.continue_curve(hopf, "c", 1.0, steps=STEPS)
    check(curve, ("Bautin", {"m": 0.0, "c": -0.28}))
    signs = {point.criticality for point in curve.points if point.system.parameters["c"] < -0.3}
    assert signs == {"supercritical"}
    assert curve.points[-1].criticality == "subcritical"


def zero_hopf(mode, t, y, p):
    square = y.y**2 + y.z**2
    return (
        p.a + y.x**2 - square,
        p.b * y.y - 2.0 * y.z + y.x * y.y,
        2.0 * y.y + p.b * y.z + y.x * y.z,
    )


ZERO_HOPF = mi.System(
    states=("x", "y", "z"), flow=zero_hopf, parameters={"a": -1.0, "b": -0.5}
)  # fmt: skip


@pytest.mark.nightly
def test_zero_hopf_on_both_curves():
    """Folds at a = 0; Hopf points at x = -b, a = -b^2, tangent to it at b = 0."""
    fold = special_point(ZERO_HOPF, {"x": -1.0}, "a", 1.0, "LP", back=-1.0)
    curve = mi.continue_curve(fold, "b", 0.5, steps=STEPS)
    check(curve, ("zero-Hopf", {"a": 0.0, "b": 0.0}))

    hopf = special_point(ZERO_HOPF, {"x": 1.0}, "a", 1.0, "H", back=-1.0)
    curve = mi.continue_curve(hopf, "b", 0.5, steps=STEPS)
    check(curve, ("zero-Hopf", {"a": 0.0, "b": 0.0}))
    assert abs(curve.table["a"] + curve.table["b"] ** 2).max() < 1e-10


def two_oscillators(mode, t, y, p):
    first, second = p.a, p.b + 0.5 * p.a + 0.2 * y.x
    r = y.x**2 + y.y**2
    return (
        first * y.x - y.y - y.x * r,
        y.x + first * y.y - y.y * r,
        second * y.u - 2.3 * y.v - y.u**3,
        2.3 * y.u + second * y.v + 0.1 * y.x**2,
    )


@pytest.mark.slow
def test_hopf_hopf():
    """The pairs are a +- i and b + a/2 +- 2.3 i."""
    system = mi.System(
        states=("x", "y", "u", "v"), flow=two_oscillators, parameters={"a": -0.3, "b": -1.0}
    )
    hopf = special_point(system, {"x": 0.0}, "a", 1.0, "H")
    curve = mi.continue_curve(hopf, "b", 1.0, steps=STEPS)
    check(curve, ("Hopf-Hopf", {"a": 0.0, "b": 0.0}))
    assert abs(curve.table["a"]).max() < 1e-10


# --- Relief valve


def valve(mode, t, y, p):
    pressure = p.beta * (p.q - y.x * math.sqrt(y.p))
    return y.v, -p.kappa * y.v - (y.x + p.delta) + y.p, pressure


# --- Guards, and sliding


def pressed(mode, t, y, p):
    return y.v, p.pull - p.k * y.x - y.v - p.s * y.x**3


@pytest.mark.slow
def test_boundary_equilibria():
    """The body meets the wall at x = 1 where pull = k + s; the equilibrium folds at k = -3 s."""
    system = mi.System(
        states=("x", "v"),
        flow=pressed,
        parameters={"pull": 0.5, "k": 1.0, "s": 1.0},
        guards=[
            mi.Impact(
                "wall",
                lambda mode, t, y, p: 1.0 - y.x,
                lambda mode, t, y, p: (mode, (y.x, -y.v)),
            ),
            mi.Guard(
                "load",
                lambda mode, t, y, p: 4.0 - p.pull - y.x,
                lambda mode, t, y, p: (mode, (y.x, y.v)),
            ),
        ],
    )
    met = special_point(system, {"x": 0.5}, "pull", 2.5, "BE")
    curve = mi.continue_curve(met, "k", -4.0, back=2.5, steps=STEPS)
    check(curve, ("boundary-fold", {"pull": -2.0, "k": -3.0}))
    assert abs(curve.table["pull"] - curve.table["k"] - 1.0).max() < 1e-10
    assert abs(curve.table["x"] - 1.0).max() < 1e-10
    other = mi.continue_curve(met, "k", 2.5, steps=STEPS)
    check(other, ("double boundary", {"pull": 3.0, "k": 2.0}))


def relayed(mode, t, y, p):
    return y.y + p.b * mode.line, -y.x + p.m * y.y - y.y**3, 0.5 * y.x - mode.line


SLIDING = mi.System(
    states=("x", "y", "z"),
    flow=relayed,
    parameters={"m": -1.0, "b": 0.5},
    parts=[mi.SwitchingSurface("line", "z")],
)


@pytest.mark.nightly
def test_hopf_points_of_pseudo_equilibria():
    """Where the state slides, the equivalent control is x/2: trace m + b/2, determinant 1 + m b/2.

    The Hopf curve m = -b/2 ends at b = 2.
    """
    (rest,) = mi.find_equilibria(SLIDING, modes=["sliding"])
    (hopf,) = mi.continue_solution(rest, "m", 1.0).special_points
    assert abs(hopf.value + 0.25) < 1e-9
    curve = mi.continue_curve(hopf, "b", 3.0, steps=STEPS)
    check(curve, ("Bogdanov-Takens", {"m": -1.0, "b": 2.0}))
    assert abs(curve.table["m"] + 0.5 * curve.table["b"]).max() < 1e-9


# --- Results


def pitchfork(mode, t, y, p):
    return p.a * y.x - p.b * y.x + y.y**2 * y.x - y.x**3 + p.d, p.a + p.b**2 - y.y


PITCHFORK = mi.System(
    states=("x", "y"), flow=pitchfork, parameters={"a": -1.0, "b": 0.5, "d": 0.0}
)  # fmt: skip


@pytest.mark.slow
def test_branch_points_that_a_symmetry_keeps():
    """Symmetric in x; a pitchfork where a - b + (a + b^2)^2 = 0, an imperfection is d."""
    crossing = special_point(PITCHFORK, {"x": 0.0, "y": -0.75}, "a", 0.5, "BP")
    curve = mi.continue_curve(crossing, "b", 1.0, steps=STEPS)
    a, b = curve.table["a"], curve.table["b"]
    assert abs(a - b + (a + b * b) ** 2).max() < 1e-9
    assert curve.ended == "b reached its bound"
    unfolded = mi.continue_curve(crossing, "d", 0.3, steps=STEPS)
    assert unfolded.ended.startswith("the branch point unfolds: at another value of d than 0,")


def test_what_is_refused():
    fold = special_point(TAKENS, {"x": -0.6}, "a", 1.0, "LP", back=-1.0)
    with pytest.raises(mi.InvalidParameter, match="other than the parameter of the branch"):
        mi.continue_curve(fold, "a", 2.0)
    events = {"high": ("y", 0.0)}
    first = mi.find_equilibria(LIFTED)[0]
    special = mi.continue_solution(first, "a", 1.0, events=events).special_points[0]
    with pytest.raises(mi.InvalidParameter, match="which have curves"):
        mi.continue_curve(special, "b", 1.0)


LIFTED = mi.System(
    states=("y",), flow=lambda mode, t, y, p: (p.a - y.y,), parameters={"a": -1.0, "b": 0.0}
)  # fmt: skip


@pytest.mark.slow
def test_curves_are_values(tmp_path):
    fold = special_point(TAKENS, {"x": -0.6}, "a", 1.0, "LP", back=-1.0)
    curve = mi.continue_curve(fold, "b", 0.5, steps=STEPS)
    curve.save(tmp_path / "curve.zip")
    again = mi.load(tmp_path / "curve.zip", system=TAKENS)
    assert again == curve
    assert again.special_table.equals(curve.special_table)
    assert "<table>" in curve._repr_html_()
    ax = mi.plot_curve(curve)
    assert [text.get_text() for text in ax.texts] == ["Bogdanov-Takens"]


def born(mode, t, y, p):
    r = y.x * y.x + y.y * y.y
    return p.a * y.x - p.w * y.y - y.x * r, p.w * y.x + p.a * y.y - y.y * r


@pytest.mark.nightly
def test_cycles_start_from_any_point_of_a_hopf_curve():
    """Their radius is sqrt(a), their period 2 pi/w."""
    system = mi.System(states=("x", "y"), flow=born, parameters={"a": -0.5, "w": 2.0})
    hopf = special_point(system, {"x": 0.0}, "a", 0.5, "H")
    curve = mi.continue_curve(hopf, "w", 4.0, steps=STEPS)
    for point in (curve.points[len(curve) // 2], curve.points[-1]):
        last = mi.switch_branch(point).orbits[-1]
        assert last.system.parameters["a"] == 0.5
        assert abs(math.hypot(last.state.x, last.state.y) - math.sqrt(0.5)) < 1e-10
        assert abs(last.period - 2.0 * math.pi / point.system.parameters["w"]) < 1e-10
