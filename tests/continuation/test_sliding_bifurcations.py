"""Sliding bifurcations, corner and border collisions: types and places, against closed forms."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import root

import mems_impact as mi

# --- A cycle that touches a wall


def spiral(mode, t, y, p):
    """The normal form of a Hopf bifurcation, whose cycle has the radius sqrt(mu), or a wall."""
    if mode.wall == 1:
        return -1.0, 0.0
    grows = p.mu - y.x**2 - y.y**2
    return grows * y.x - p.w * y.y, p.w * y.x + grows * y.y


@pytest.fixture(scope="module")
def growth():
    system = mi.System(
        states=("x", "y"), flow=spiral, parameters={"mu": 0.8, "w": 1.5}, initial={"x": 0.5},
        parts=[mi.SwitchingSurface("wall", "x", level=1.0)],
    )  # fmt: skip
    return mi.continue_solution(mi.find_orbit(system, transient=50), "mu", stop=1.1)


@pytest.mark.slow
def test_a_cycle_grazes_its_sliding_region_from_either_side(growth):
    shrinks = mi.continue_solution(growth.orbits[-1], "mu", stop=0.8)
    for branch in (growth, shrinks):
        assert branch.ended == "mu reached its bound"
        assert branch.table.admissible.all()
        assert branch.table.stable.all()
        (point,) = branch.special_points
        assert point.value == pytest.approx(1.0, abs=1e-12)
        found = point.type
        assert found == "grazing-sliding"
        assert found.modes == ("below", "below")
        assert (found.tangent, found.other, found.sliding) == ("below", "above", "sliding")
        assert found.tangency == "visible"
        # At (1, 0) the height 1 - x has the second derivative w^2.
        assert found.second == pytest.approx(1.5**2, rel=1e-8)
        assert found.rates == pytest.approx((0.0, 1.0), abs=1e-9)
        assert (found.state.x, found.state.y) == pytest.approx((1.0, 0.0), abs=1e-9)
        assert branch.special_table["type"].tolist() == ["grazing-sliding"]
    sides = [growth.orbits[i].segments["mode"].tolist() for i in (0, -1)]
    assert sides[0] == ["below"]
    assert "sliding" in sides[1]


@pytest.mark.nightly
def test_grazing_sliding_is_a_curve(growth):
    curve = mi.continue_curve(growth.special_points[0], "w", stop=2.0)
    assert curve.ended == "w reached its bound"
    assert np.abs(curve.table.mu - 1.0).max() < 1e-11


@pytest.mark.slow
def test_a_type_is_a_string_with_the_numbers_of_its_criterion(growth):
    found = growth.special_points[0].type
    again = pickle.loads(pickle.dumps(found))
    assert again == found
    assert again.second == found.second
    assert (f"{found}", found.label) == ("grazing-sliding", "GS")
    assert [text.get_text() for text in mi.plot_branch(growth).texts] == ["GS"]


@pytest.mark.slow
def test_a_type_that_cannot_be_determined_says_why(growth, monkeypatch):
    def fails(*_):
        raise ZeroDivisionError("float division by zero")

    monkeypatch.setattr("mems_impact.continuation.sliding.Junction.gradient", fails)
    point = replace(growth.special_points[0])  # of which no type is known
    with pytest.raises(mi.OrbitError, match="a function of the system fails near the point"):
        _ = point.type


# --- A block with dry friction 1 on a spring, under two harmonics, in closed form

W = 0.7
PERIOD = 2.0 * math.pi / W


def block(**values):
    def flow(mode, t, y, p):
        return y.v, -y.x + p.A * math.cos(W * t) + p.B * math.sin(2.0 * W * t)

    return mi.System(
        states=("x", "v"), flow=flow, period=PERIOD, parameters={"A": 1.7, "B": 0.1, **values},
        parts=[mi.Friction("ground", "v", mu=1.0)],
    )  # fmt: skip


FORCES = {"f": -1.0, "b": 1.0}  # of friction on a block that slips forwards or backwards


def exact(path, special, guess, first):
    """Return the amplitude B of a bifurcation of an orbit that slips and sticks as `path`.

    The orbit begins with a slip from rest. Slips end at rest, and a stick ("s") ends where the load
    reaches the limit, on the side of the next slip. `special` is an added condition: the load at
    the start of a segment is at a limit ("load"), the speed touches zero within a slip ("speed"),
    or the load a limit within a stick ("touch"). `guess` has B, x, the times of all starts and that
    of the contact.
    """
    kind, at, limit = special

    def load(t, x, second):
        return first * math.cos(W * t) + second * math.sin(2.0 * W * t) - x

    def load_rate(t, second):
        return 2.0 * W * second * math.cos(2.0 * W * t) - W * first * math.sin(W * t)

    def forced(t, second):
        one, two = first / (1.0 - W * W), second / (1.0 - 4.0 * W * W)
        x = one * math.cos(W * t) + two * math.sin(2.0 * W * t)
        return x, -W * one * math.sin(W * t) + 2.0 * W * two * math.cos(2.0 * W * t)

    def slipped(begin, end, x, f, second):
        """Return x and v after a slip: x = f + c cos(t - begin) + d sin(t - begin) + forced."""
        here, rate = forced(begin, second)
        c, d, lasts = x - f - here, -rate, end - begin
        there, moves = forced(end, second)
        cos, sin = math.cos(lasts), math.sin(lasts)
        return f + c * cos + d * sin + there, moves - c * sin + d * cos

    def equations(unknowns):
        second, x = start = unknowns[:2]
        times = [*unknowns[2 : 2 + len(path)], unknowns[2] + PERIOD]
        found = []
        for i, mode in enumerate(path):
            begin, end = times[i], times[i + 1]
            if (kind, at) == ("load", i):
                found.append(load(begin, x, second) - limit)
            if (kind, at) == ("speed", i):
                there, speed = slipped(begin, unknowns[-1], x, FORCES[mode], second)
                found += [speed, load(unknowns[-1], there, second) + FORCES[mode]]
            if (kind, at) == ("touch", i):
                found += [load(unknowns[-1], x, second) - limit, load_rate(unknowns[-1], second)]
            if mode == "s":
                following = path[(i + 1) % len(path)]
                found.append(load(end, x, second) + FORCES[following])
            else:
                x, speed = slipped(begin, end, x, FORCES[mode], second)
                found.append(speed)
        return [*found, x - start[1]]

    solution = root(equations, guess, tol=1e-15)
    assert np.abs(solution.fun).max() < 1e-12
    return solution.x[0]


TURN = PERIOD
POINTS = {
    "crossing": ("bf", ("load", 0, -1.0), (0.163, 2.631, 0.710, 5.351)),
    "grazing": ("bfs", ("speed", 1, 0.0), (1.029, 1.209, 2.164, 5.362, 1.629 + TURN, 0.321 + TURN)),
    "switching": (
        "fsbfs", ("load", 4, -1.0), (1.310, 1.586, 0.696, 1.164, 2.048, 5.291, 8.382),
    ),
    "adding": (
        "bfbs", ("touch", 3, 1.0), (1.693, 1.986, 1.962, 5.225, 8.137, 0.441 + TURN, 0.906 + TURN),
    ),
    "second crossing": (
        "fsbfb", ("load", 0, 1.0), (1.840, 1.852, 0.547, 1.610, 1.994, 5.210, 8.074),
    ),
}  # fmt: skip
"""Path, condition and guess of each point at A = 1.7, in their order along the branch."""
STEPS = mi.StepControl(max_points=400)


@pytest.fixture(scope="module")
def climb():
    return mi.continue_solution(mi.find_orbit(block(), transient=200), "B", stop=2.0, steps=STEPS)


def named(branch):
    """Return the points of a branch that `POINTS` lists, by name, in their order along it."""
    found = [point for point in branch.special_points if not 1.311 < point.value < 1.314]
    names = list(POINTS) if found[0].value < found[-1].value else list(POINTS)[::-1]
    return dict(zip(names, found, strict=True))


@pytest.mark.nightly
def test_a_branch_passes_all_sliding_bifurcations(climb):
    back = mi.continue_solution(climb.orbits[-1], "B", stop=0.1, steps=STEPS)
    for branch in (climb, back):
        assert branch.ended == "B reached its bound"
        assert branch.table.admissible.all()
        assert len(branch.special_points) == 6
        for name, point in named(branch).items():
            found = point.type
            assert found == f"{name.split()[-1]}-sliding"
            assert point.value == pytest.approx(exact(*POINTS[name], 1.7), abs=1e-10)
            expected = {"adding": "cubic", "switching": "invisible"}.get(name, "visible")
            assert found.tangency == expected
            assert found.rates == pytest.approx((0.0, 2.0), abs=1e-7)


@pytest.mark.nightly
def test_runs_stick_and_turn_as_often_as_the_branch_between_its_points(climb):
    table, counts = climb.table, []
    for piece in range(7):
        rows = np.flatnonzero((table.piece == piece) & table.stable)
        orbit = climb.orbits[rows[len(rows) // 2]]
        modes = orbit.segments["mode"].tolist()
        # A segment that continues over the start of the period is entered once.
        entered = [mode for before, mode in zip([modes[-1], *modes], modes, strict=False)
                   if mode != before]  # fmt: skip
        counts.append(tuple(entered.count(mode) for mode in ("stuck", "forward", "backward")))
        run = mi.simulate(orbit.system, 340)
        last = run.events[run.events["period"] >= 300]["mode after"]
        runs = tuple((last == mode).sum() / 40 for mode in ("stuck", "forward", "backward"))
        assert runs == counts[-1]
    # The sliding bifurcations add and remove a stick, and switching-sliding a short slip beside it.
    rests = [stuck for stuck, _, _ in counts]
    assert rests == [0, 1, 2, 2, 1, 2, 1]
    assert counts[2:4] == [(2, 2, 1), (2, 2, 2)]


@pytest.mark.nightly
@pytest.mark.parametrize("name", POINTS)
def test_sliding_bifurcations_are_curves(climb, name):
    curve = mi.continue_curve(named(climb)[name], "A", stop=1.69)
    assert curve.ended == "A reached its bound"
    path, special, guess = POINTS[name]
    begun = exact(path, special, guess, 1.7)
    assert curve.table.B.iloc[0] == pytest.approx(begun, abs=1e-9)
    last = curve.table.iloc[-1]
    assert pytest.approx(exact(path, special, guess, 1.69), abs=1e-9) == last.B


# --- Excursions from sliding that vanish


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [0.0, 0.05])
@pytest.mark.parametrize("part", ["surface", "friction"])
def test_a_branch_passes_excursions_from_sliding_that_vanish(part, tilt):
    """The load reaches the limit 1.3 up at A = 1.3 - tilt and down at A = 1.3 + tilt."""

    def flow(mode, t, y, p):
        hold = 1.3 * mode.line if part == "surface" else 0.0
        return p.A * math.cos(t - 0.7) + p.tilt - hold, y.x - 0.4 * y.z + math.sin(t)

    line = (
        mi.SwitchingSurface("line", "x") if part == "surface" else mi.Friction("line", "x", mu=1.3)
    )
    system = mi.System(
        states=("x", "z"), flow=flow, period=2.0 * math.pi, parameters={"A": 1.5, "tilt": tilt},
        parts=[line],
    )  # fmt: skip
    shrinks = mi.continue_solution(mi.find_orbit(mi.simulate(system, 40)), "A", stop=1.1)
    grows = mi.continue_solution(shrinks.orbits[-1], "A", stop=1.5)
    peaks = sorted({1.3 - tilt, 1.3 + tilt})
    for branch, values in ((shrinks, peaks[::-1]), (grows, peaks)):
        assert branch.ended == "A reached its bound"
        assert branch.table.admissible.all()
        # The linear filter remembers, the sliding state does not.
        decay = math.exp(-0.8 * math.pi)
        assert branch.table["largest multiplier"].to_numpy() == pytest.approx(decay, abs=1e-9)
        assert [point.value for point in branch.special_points] == pytest.approx(values, abs=1e-10)
        for point in branch.special_points:
            found = point.type
            assert found == "adding-sliding"
            assert found.third == pytest.approx(-point.value, rel=1e-8)


# --- A published oscillator on a belt


@pytest.mark.nightly
def test_the_published_friction_oscillator_grazes_its_sliding_region():
    """A cycle of four forcing periods, in a cubic law of friction under a weak forcing.

    Its grazing-sliding is published at the frequency 1.7077997 (di Bernardo, Kowalczyk and Nordmark
    2003); the coefficients of the law are 1.5, 1.5 and 0.45, the amplitude of the forcing is 0.1.
    """
    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -y.x + 0.1 * math.sin(p.w * t)),
        period=lambda p: 2.0 * math.pi / p.w,
        parameters={"w": 1.72},
        parts=[
            mi.Friction(
                "belt", "v", mu=lambda u, p: 1.5 - 1.5 * u + 0.45 * u**3, surface=1.0
            )
        ],
    )  # fmt: skip
    twice = mi.continue_solution(mi.find_orbit(system, transient=1000), "w", stop=1.705)
    (doubling,) = (point for point in twice.special_points if point.label == "PD")
    branch = mi.switch_branch(doubling, bounds=(1.70, 1.72))
    (point,) = branch.special_points
    assert point.value == pytest.approx(1.7077997, abs=5e-8)
    found = point.type
    assert (found, found.tangency, found.sliding) == ("grazing-sliding", "visible", "stuck")
    rows = branch.table.w < point.value - 1e-9
    # The cycle sticks beyond it, and is unstable there.
    assert branch.table.stable[~rows][2:].all()
    assert not branch.table.stable[rows].any()
    assert branch.table.admissible.all()
    assert "stuck" in branch.orbits[-1].segments["mode"].tolist()
    for w, sticks in ((1.709, False), (1.707, True)):
        events = mi.simulate(system.changed(w=w), 1500).events
        late = events[events["period"] >= 1400]
        assert ("stuck" in late["mode after"].tolist()) == sticks


# --- Static friction above dynamic friction


# --- Corners and borders


def corner(mode, t, y, p):
    """A cycle of the radius sqrt(mu), pushed where both surfaces lie below it."""
    grows = 0.1 * (p.mu - y.x**2 - y.y**2)
    push = 0.3 if mode.right == 1 and mode.top == 1 else 0.0
    return grows * y.x - y.y + push, y.x + grows * y.y


@pytest.mark.nightly
def test_a_cycle_passes_the_intersection_of_two_surfaces():
    system = mi.System(
        states=("x", "y"), flow=corner, parameters={"mu": 0.8, "a": 0.6}, initial={"x": 0.5},
        parts=[
            mi.SwitchingSurface("right", "x", level="a"), mi.SwitchingSurface("top", "y", level=0.8)
        ],
    )  # fmt: skip
    grows = mi.continue_solution(mi.find_orbit(system, transient=50), "mu", stop=1.3)
    shrinks = mi.continue_solution(grows.orbits[-1], "mu", stop=0.8)
    for branch, steps in ((grows, 1), (shrinks, -1)):
        (point,) = branch.special_points
        assert point.value == pytest.approx(1.0, abs=1e-10)
        found = point.type
        assert (found, found.surfaces) == ("corner collision", ("right", "top"))
        assert branch.table.admissible.all()
        assert branch.table.stable.all()
        inside = ["above-above" in orbit.segments["mode"].tolist() for orbit in branch.orbits]
        assert inside[::steps] == sorted(inside)
    curve = mi.continue_curve(grows.special_points[0], "a", stop=0.7)
    exact_mu = curve.table.a**2 + 0.64
    assert curve.table.mu.to_numpy() == pytest.approx(exact_mu.to_numpy(), abs=1e-9)


LEFT, RIGHT = mi.modes("left", "right")


def still(mode, t, y, p):
    return (0.0,)


def skewed(mode, t, y, p):
    x = (p.a if mode == LEFT else p.b) * y.x + p.mu
    return (LEFT if x < 0.0 else RIGHT), (x,)


@pytest.mark.nightly
@pytest.mark.parametrize("guarded", [False, True])
def test_a_fixed_point_of_a_map_passes_its_border(guarded):
    """The skew tent map, with the fixed points mu/(1 - a) and mu/(1 - b)."""
    border = mi.Guard(
        "border",
        lambda mode, t, y, p: y.x if mode == RIGHT else -y.x,
        lambda mode, t, y, p: (LEFT if mode == RIGHT else RIGHT, (y.x,)),
    )
    tent = mi.System(
        states=("x",), modes=("left", "right"), flow=still, switches=(1.0,), period=1.0,
        switch_transition=skewed, guards=[border] if guarded else [],
        parameters={"a": 0.5, "b": -0.7, "mu": -0.3}, initial=mi.State(x=-0.6, mode="left"),
    )  # fmt: skip
    for start in (-0.3, 0.3):
        branch = mi.continue_solution(
            mi.find_orbit(tent.changed(mu=start), transient=50), "mu", stop=-start
        )
        assert branch.ended == "mu reached its bound"
        (point,) = branch.special_points
        assert point.value == pytest.approx(0.0, abs=1e-12)
        assert point.type == "border collision"
        table = branch.table
        fixed = table.mu / (1.0 - np.where(table.mu < 0.0, 0.5, -0.7))
        assert table.x.to_numpy() == pytest.approx(fixed.to_numpy(), abs=1e-9)
        multipliers = np.where(table.mu < -1e-9, 0.5, 0.7)[[0, -1]]
        assert table["largest multiplier"].to_numpy()[[0, -1]] == pytest.approx(multipliers)
    if guarded:
        curve = mi.continue_curve(point, "b", stop=-0.5)
        assert np.abs(curve.table.mu).max() < 1e-10
