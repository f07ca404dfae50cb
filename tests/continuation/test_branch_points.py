"""Branch points: where a branch of orbits that break a symmetry crosses the symmetric one."""

import math

import numpy as np
import pytest

import mems_impact as mi


def pitchfork(mode, t, y, p):
    return ((p.a + p.b * math.cos(t)) * y.x - y.x**3,)


SYMMETRIC = mi.System(
    states=("x",),
    flow=pitchfork,
    period=2.0 * math.pi,
    parameters={"a": -0.1, "b": 1.0},
    initial={"x": 0.5},
)


@pytest.mark.slow
def test_another_branch_crosses():
    """The multiplier of the orbit at rest is exp(2 pi a)."""
    rest = mi.find_orbit(SYMMETRIC, guess={"x": 0.0}, periods=1)
    branch = mi.continue_solution(rest, "a", 0.5)
    (crossing,) = branch.special_points
    assert crossing.label == "BP"
    assert abs(crossing.value) < 1e-9
    curve = mi.continue_curve(crossing, "b", 1.5)
    assert curve.ended == "b reached its bound"
    assert np.abs(curve.table["a"]).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(("offset", "labels"), [(0.0, ["BP"]), (1e-9, []), (-1e-8, [])])
def test_an_imperfection_above_the_error_of_integration_is_no_branch_point(offset, labels):
    """x'' + d x' + x^3 = a cos t + offset, whose symmetric orbit loses stability at a = 2.403."""
    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, p.a * math.cos(t) + p.offset - p.d * y.v - y.x**3),
        period=2.0 * math.pi,
        parameters={"a": 2.0, "d": 0.2, "offset": offset},
        typical={"offset": 1e-3},
    )
    options = mi.Options(method="dop853", rtol=1e-12, atol=1e-14)
    orbit = mi.find_orbit(system, transient=100, periods=1, options=options)
    branch = mi.continue_solution(orbit, "a", stop=2.6)
    assert [special.label for special in branch.special_points] == labels
    assert branch.orbits[-1].stable is not bool(labels)


def of_equilibrium(flow, start, **values):
    (found, *_) = mi.find_equilibria(
        mi.System(states=("x",), flow=flow, parameters=values), guess={"x": start}
    )
    return found


@pytest.mark.quick(1)
@pytest.mark.parametrize("error", [0.0, 1e-10])
def test_an_error_of_the_equations_neither_moves_a_branch_point_nor_adds_a_fold(error):
    def fork(mode, t, y, p):
        return (p.a * y.x - y.x**3 + p.error,)

    rest = of_equilibrium(fork, 0.0, a=-1.0, error=error)
    off = of_equilibrium(fork, 0.9, a=1.0, error=error)
    for begin, stop in ((rest, 1.0), (off, -1.0)):
        branch = mi.continue_solution(begin, "a", stop, back=begin.system.parameters["a"])
        assert [point.label for point in branch.special_points] == ["BP"]
        assert abs(branch.special_points[0].value) < 1e-12


def test_branches_that_cross_at_an_angle():
    begin = of_equilibrium(lambda mode, t, y, p: ((p.a - 0.3) * y.x - y.x**2,), 0.0, a=-1.0)
    (crossing,) = mi.continue_solution(begin, "a", 1.0).special_points
    assert crossing.label == "BP"
    assert crossing.value == pytest.approx(0.3, abs=1e-13)


MAP = ("q", "c", "d", "t11", "t12", "t21", "t22", "r", "l", "k1", "k2", "k3", "k4")
MAP += ("s11", "s12", "s21", "s22")


def oblique(mode, t, y, p):
    """A map whose fixed point (c q, d q) another parameter crosses where (0.95 + r q) is one."""
    a, b = y.x - p.c * p.q, y.y - p.d * p.q
    u, w = p.t11 * a + p.t12 * b, p.t21 * a + p.t22 * b
    u, w = (
        (0.95 + p.r * p.q) * u + p.k1 * u * u + p.k2 * u * w,
        p.l * w + p.k3 * u * u + p.k4 * w * w,
    )
    return mode, (p.c * p.q + p.s11 * u + p.s12 * w, p.d * p.q + p.s21 * u + p.s22 * w)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [13, 18, 41])
def test_branch_points_of_maps_where_residuals_are_rounding(seed):
    random = np.random.default_rng(seed)
    t = random.standard_normal((2, 2))
    s, (c, d) = np.linalg.inv(t), 0.5 * random.standard_normal(2)
    r, slow, k = random.uniform(0.1, 0.5), random.uniform(-0.9, 0.6), random.standard_normal(4)
    values = dict(zip(MAP, [0.0, c, d, *t.ravel(), r, slow, *k, *s.ravel()], strict=True))
    system = mi.System(
        states=("x", "y"),
        flow=lambda mode, t, y, p: (0.0, 0.0),
        switch_transition=oblique,
        switches=(0.5,),
        period=1.0,
        parameters={name: float(value) for name, value in values.items()},
    )
    options = mi.Options(method="dop853", engine="interpreted")
    rest = mi.find_orbit(system, periods=1, options=options, guess=mi.State(x=0.0, y=0.0))
    branch = mi.continue_solution(rest, "q", 0.09 / r, back=-1.0)
    (crossing,) = (point for point in branch.special_points if point.label == "BP")
    assert crossing.value == pytest.approx(0.05 / r, rel=1e-10)


def symmetric_map(mode, t, y, p):
    x = (1.0 + p.a - p.c**2) * y.x - y.x**3 + p.d
    return mode, (x, (0.3 + p.c) * y.w + 0.1 * y.x**2)


def crossing_of(transition):
    system = mi.System(
        states=("x", "w"),
        flow=lambda mode, t, y, p: (0.0, 0.0),
        switch_transition=transition,
        switches=(0.5,),
        period=1.0,
        parameters={"a": -0.2, "c": 0.1, "d": 0.0},
    )
    options = mi.Options(method="dop853")
    rest = mi.find_orbit(system, periods=1, options=options, guess=mi.State(x=0.0, w=0.0))
    steps = mi.StepControl(max_step=0.1)
    (crossing,) = mi.continue_solution(rest, "a", 0.3, steps=steps).special_points
    return crossing


@pytest.mark.nightly
def test_curves_of_branch_points_of_maps():
    """With a symmetry a = c^2 at the branch point; the other multiplier is 0.3 + c."""
    fork = crossing_of(symmetric_map)
    steps = mi.StepControl(initial_step=0.1, max_step=1.0)
    curve = mi.continue_curve(fork, "c", -1.5, back=0.2, steps=steps)
    a, c = (curve.table[name].to_numpy() for name in ("a", "c"))
    assert a == pytest.approx(c**2, abs=1e-10)
    assert curve.ended == "c reached its bound"
    (flip,) = curve.special_points
    assert flip.kind == "branch point-flip"
    assert flip.values == pytest.approx({"a": 1.69, "c": -1.3}, abs=1e-9)
    unfolded = mi.continue_curve(fork, "d", 0.1)
    assert unfolded.ended.startswith("the branch point unfolds: at another value of d than 0,")
    assert len(unfolded) == 1
    with pytest.raises(mi.InvalidParameter, match="other than the parameter of the branch"):
        mi.continue_curve(fork, "a", 1.0)
