"""Equilibria against closed forms: places, eigenvalues, and where they change."""

import copy
import math
import pickle

import numpy as np
import pytest

import mems_impact as mi


def lorenz(mode, t, y, p):
    return p.s * (y.y - y.x), y.x * (p.r - y.z) - y.y, y.x * y.y - p.b * y.z


LORENZ = mi.System(
    states=("x", "y", "z"),
    flow=lorenz,
    parameters={"s": 10.0, "r": 20.0, "b": 8.0 / 3.0},
    initial={"x": 5.0, "y": 5.0, "z": 19.0},
)


def pendulum(mode, t, y, p):
    return y.speed, -math.sin(y.angle) - p.damping * y.speed


PENDULUM = mi.System(states=("angle", "speed"), flow=pendulum, parameters={"damping": 0.1})

FREE, HELD = mi.modes("free", "held")


def pulled(mode, t, y, p):
    return (y.v, p.pull - y.x - y.v) if mode == FREE else (0.0, 0.0)


def gap(mode, t, y, p):
    return 1.0 - y.x


def strike(mode, t, y, p):
    return FREE, (1.0, -0.5 * y.v)


WALL = mi.System(
    states=("x", "v"),
    flow=pulled,
    parameters={"pull": 0.5},
    modes=(FREE, HELD),
    guards=[mi.Impact("wall", gap, strike, modes=(FREE,))],
)


def one_state(flow, **parameters):
    return mi.System(states=("x",), flow=flow, parameters=parameters)


def test_all_within_bounds_with_closed_form_eigenvalues():
    found = mi.find_equilibria(PENDULUM, box={"angle": (-1.0, 4.0)})
    hanging, upright = found  # in the order of their places
    assert abs(hanging.state.angle) < 1e-12
    assert abs(upright.state.angle - math.pi) < 1e-12
    root = math.sqrt(1.0 - 0.05**2)
    assert abs(hanging.eigenvalues - [-0.05 + 1j * root, -0.05 - 1j * root]).max() < 1e-10
    root = math.sqrt(1.0 + 0.05**2)
    assert abs(upright.eigenvalues - [-0.05 + root, -0.05 - root]).max() < 1e-10
    assert hanging.stable
    assert not upright.stable
    assert hanging.nullity == 0
    assert hanging.admissible
    assert hanging.mode == "free"


def test_a_guess_leads_to_the_nearest():
    (found,) = mi.find_equilibria(PENDULUM, guess={"angle": 3.0})
    assert abs(found.state.angle - math.pi) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(("s", "b"), [(10.0, 8.0 / 3.0), (16.0, 4.0)])
def test_hopf_point_of_lorenz(s, b):
    (first,) = mi.find_equilibria(LORENZ.changed(s=s, b=b))
    branch = mi.continue_solution(first, "r", 50.0)
    (hopf,) = branch.special_points
    # Sparrow, The Lorenz Equations (1982): r = s (s + b + 3)/(s - b - 1).
    exact = s * (s + b + 3.0) / (s - b - 1.0)
    assert hopf.label == "H"
    assert abs(hopf.value - exact) < 1e-9
    frequency = math.sqrt(2.0 * s * (s + 1.0) * b / (s - b - 1.0))
    assert abs(hopf.equilibrium.eigenvalues[0] - 1j * frequency) < 1e-8
    assert branch.ended == "r reached its bound"
    rows = branch.table[abs(branch.table["r"] - exact) > 1e-6]
    assert len(rows) == len(branch) - 1  # the point itself is on the branch
    assert (rows["stable"] == (rows["r"] < exact)).all()
    x = branch.table["x"].to_numpy()
    assert abs(x - np.sqrt(b * (branch.table["r"].to_numpy() - 1.0))).max() < 1e-10


def test_fold_is_passed_and_the_branch_comes_back():
    system = one_state(lambda mode, t, y, p: (p.a - 0.25 + y.x * y.x,), a=-1.0)
    lower = mi.find_equilibria(system, guess={"x": -1.0})[0]
    branch = mi.continue_solution(lower, "a", 1.0, back=-1.0)
    (fold,) = branch.special_points
    assert fold.label == "LP"
    assert abs(fold.value - 0.25) < 1e-10
    assert abs(branch.equilibria[-1].state.x - math.sqrt(1.25)) < 1e-10
    assert lower.stable
    assert not branch.equilibria[-1].stable
    assert branch.equilibria[-1].system.parameters["a"] == -1.0


def test_another_branch_crosses():
    system = one_state(lambda mode, t, y, p: (p.a * y.x - y.x**3,), a=-1.0)
    (rest,) = mi.find_equilibria(system)
    branch = mi.continue_solution(rest, "a", 1.0)
    (crossing,) = branch.special_points
    assert crossing.label == "BP"
    assert abs(crossing.value) < 1e-9
    one = mi.find_equilibria(system.changed(a=1.0), guess={"x": 0.9})[0]
    branch = mi.continue_solution(one, "a", -1.0, back=1.0)
    assert [each.label for each in branch.special_points] == ["BP"]  # no fold beside it
    assert abs(branch.equilibria[-1].state.x + 1.0) < 1e-9


def test_two_real_eigenvalues_of_sum_zero_are_no_hopf_point():
    system = mi.System(
        states=("x", "y"), flow=lambda mode, t, y, p: (p.a * y.x, -y.y), parameters={"a": 0.5}
    )
    (saddle,) = mi.find_equilibria(system)
    assert mi.continue_solution(saddle, "a", 2.0).special_points == ()


def test_a_guard_makes_it_virtual():
    (free,) = mi.find_equilibria(WALL, modes=["free"])
    branch = mi.continue_solution(free, "pull", 2.0)
    (met,) = branch.special_points
    assert (met.label, met.guard) == ("BE", "wall")
    assert abs(met.value - 1.0) < 1e-10
    last = branch.equilibria[-1]
    assert not last.admissible
    assert last.violated_guards == ("wall",)
    assert "virtual" in repr(last)
    assert list(branch.table["admissible"]) == list(branch.table["pull"] < 1.0 + 1e-9)


def test_continuum_of_a_mode_in_which_nothing_moves():
    _, held = mi.find_equilibria(WALL, guess={"x": 0.25})
    assert held.mode == "held"
    assert held.nullity == 2
    assert held.state.x == 0.25
    assert held.stable
    assert held.eigenvalues.size == 0
    assert "continuum" in repr(held)
    with pytest.raises(mi.InvalidParameter, match="isolated"):
        mi.continue_solution(held, "pull", 1.0)


def test_cyclic_states_need_not_stand_still():
    system = mi.System(
        states=("place", "v"),
        flow=lambda mode, t, y, p: (y.v, p.push - 0.5 * y.v),
        parameters={"push": 1.0},
        cyclic=("place",),
    )
    (cruise,) = mi.find_equilibria(system)
    assert abs(cruise.state.v - 2.0) < 1e-12
    assert abs(cruise.eigenvalues - [-0.5]).max() < 1e-11
    assert list(mi.continue_solution(cruise, "push", 2.0).table.columns[-1:]) == ["v"]


def test_steep_friction_law():
    # Its derivatives grow by a factor of 50 each: the shorter differences have to win.
    system = one_state(lambda mode, t, y, p: (p.a - math.tanh(50.0 * y.x),), a=0.3)
    (found,) = mi.find_equilibria(system)
    assert abs(found.state.x - math.atanh(0.3) / 50.0) < 1e-11
    assert abs(found.eigenvalues[0] / (-50.0 * (1.0 - 0.3**2)) - 1.0) < 1e-9


def test_what_is_refused():
    forced = mi.System(states=("x",), flow=lambda mode, t, y, p: (-y.x,), period=1.0)
    with pytest.raises(mi.InvalidParameter, match="find_orbit"):
        mi.find_equilibria(forced)
    none = one_state(lambda mode, t, y, p: (1.0 + y.x * y.x + p.a,), a=0.0)
    with pytest.raises(mi.OrbitError, match="box="):
        mi.find_equilibria(none)
    with pytest.raises(mi.InvalidParameter, match="box"):
        mi.find_equilibria(PENDULUM, box={"angle": (1.0, -1.0)})
    with pytest.raises(mi.InvalidParameter, match="box"):
        mi.find_equilibria(PENDULUM, box={"height": (0.0, 1.0)})
    with pytest.raises(mi.InvalidParameter, match="modes"):
        mi.find_equilibria(WALL, modes=["flying"])
    undefined = one_state(lambda mode, t, y, p: (math.sqrt(y.x - 1.0) + p.a,), a=0.0)
    with pytest.raises(mi.OrbitError, match="not defined"):
        mi.find_equilibria(undefined)


@pytest.mark.slow
def test_results_are_values(tmp_path):
    (first,) = mi.find_equilibria(LORENZ)
    branch = mi.continue_solution(first, "r", 30.0)
    assert pickle.loads(pickle.dumps(branch)) == branch == copy.deepcopy(branch)
    for value in (first, branch, branch.special_points[0]):
        value.save(tmp_path / "it.zip")
        again = mi.load(tmp_path / "it.zip", system=LORENZ)
        assert again == value
        assert repr(again) == repr(value)
        assert "<table>" in value._repr_html_()
    branch.save(tmp_path / "branch.zip")
    shown = mi.load(tmp_path / "branch.zip")
    assert shown.special_table.equals(branch.special_table)
    assert list(branch.table.columns[:4]) == ["r", "stable", "admissible", "largest real part"]


@pytest.mark.quick(1)
@pytest.mark.parametrize("imperfection", [1e-8, 1e-6, -1e-7])
def test_an_imperfect_pitchfork_is_no_branch_point(imperfection):
    """x' = m x - x^3 + e: the branch from m < 0 turns to the side of e, without a special point."""
    system = mi.System(
        states=("x",), flow=lambda mode, t, y, p: (p.m * y.x - y.x**3 + p.e,),
        parameters={"m": -1.0, "e": imperfection},
    )  # fmt: skip
    (rest,) = mi.find_equilibria(system, guess={"x": imperfection})
    branch = mi.continue_solution(rest, "m", stop=1.0)
    assert branch.special_points == ()
    last = branch.equilibria[-1]
    exact = math.copysign(max(np.roots([1.0, 0.0, -1.0, -abs(imperfection)]).real), imperfection)
    assert last.state.x == pytest.approx(exact, abs=1e-10)
    assert last.stable


@pytest.mark.slow
def test_figure_of_a_branch():
    (first,) = mi.find_equilibria(LORENZ)
    branch = mi.continue_solution(first, "r", 30.0, steps=mi.StepControl(max_step=0.5))
    ax = mi.plot_branch(branch)
    assert {text.get_text() for text in ax.texts} == {"H"}
    assert [line.get_label() for line in ax.get_lines()[:2]] == [
        "stable equilibrium",
        "unstable equilibrium",
    ]
    assert "section" not in ax.get_ylabel()
    assert "period" not in ax.get_ylabel()


def normal_form(mode, t, y, p):
    r = y.x * y.x + y.y * y.y
    return p.a * y.x - p.w * y.y - y.x * r, p.w * y.x + p.a * y.y - y.y * r


@pytest.mark.slow
def test_cycles_that_are_born_at_a_hopf_point():
    """Their radius is sqrt(a), their period 2 pi/w, their multiplier exp(-2 a period)."""
    system = mi.System(states=("x", "y"), flow=normal_form, parameters={"a": -0.5, "w": 2.0})
    (rest,) = mi.find_equilibria(system)
    (hopf,) = mi.continue_solution(rest, "a", 0.5).special_points
    cycles = mi.switch_branch(hopf)
    first, last = cycles.orbits[0], cycles.orbits[-1]
    assert 0.0 < first.system.parameters["a"] < 1e-5
    assert last.system.parameters["a"] == 0.5
    assert last.stable
    assert abs(math.hypot(last.state.x, last.state.y) - math.sqrt(0.5)) < 1e-10
    assert abs(last.period - math.pi) < 1e-10
    assert abs(last.multipliers[0] - math.exp(-math.pi)) < 1e-9
    back = mi.continue_solution(last, "a", -0.5)
    assert "shrinks to an equilibrium" in back.ended
    assert abs(back.orbits[-1].system.parameters["a"]) < 1e-4


def test_a_fold_bears_no_cycle():
    system = one_state(lambda mode, t, y, p: (p.a + y.x * y.x,), a=-1.0)
    lower = mi.find_equilibria(system, guess={"x": -1.0})[0]
    (fold,) = mi.continue_solution(lower, "a", 1.0, back=-1.0).special_points
    with pytest.raises(mi.InvalidParameter, match="Hopf"):
        mi.switch_branch(fold)


def padded(mode, t, y, p):
    return y.v, -y.x - (3.0 * (y.x - 1.0) if mode.pad == 1 else 0.0) - 0.1 * y.v + p.load


def test_no_mode_of_a_part_stands_still_off_its_surface():
    system = mi.System(
        states=("x", "v"),
        flow=padded,
        parameters={"load": 0.6},
        parts=[mi.SwitchingSurface("pad", "x", level=1.0)],
    )
    (below,) = [each for each in mi.find_equilibria(system) if each.admissible]
    assert (below.mode, below.state.x) == ("below", pytest.approx(0.6, abs=1e-12))
    pressed = mi.find_equilibria(system.changed(load=2.0), guess={"x": 1.3})
    held = [each for each in pressed if each.admissible]
    assert [(each.mode, each.state.x) for each in held] == [
        ("above", pytest.approx(1.25, abs=1e-12))
    ]


def test_a_stuck_body_may_stand_still_where_friction_holds_it():
    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -p.k * y.x),
        parameters={"k": 1.0},
        parts=[mi.Friction("ground", "v", mu=0.5)],
    )
    (held,) = mi.find_equilibria(system, guess={"x": 0.3}, modes=["stuck"])
    assert held.nullity > 0
    assert held.admissible
    (slips,) = mi.find_equilibria(system, guess={"x": 0.8}, modes=["stuck"])
    assert slips.violated_guards == ("ground slips",)


def heated(mode, t, y, p):
    return 0.05 + p.power * mode.first - y.T, 0.05 + p.power * mode.second - y.U


def test_both_modes_of_a_relay_may_stand_still_within_its_hysteresis():
    room = mi.System(
        states=("T", "U"),
        flow=heated,
        parameters={"power": 1.0},
        time_scale=1.0,
        parts=[
            mi.Relay("first", "T", lower=0.9, upper=1.1),
            mi.Relay("second", "U", lower=-0.1, upper=0.5),
        ],
    )
    found = mi.find_equilibria(room, guess={"T": 1.0, "U": 0.2})
    assert {each.mode for each in found if each.admissible} == {
        "low-low", "high-low", "low-high", "high-high",
    }  # fmt: skip
    for each in found:
        first, second = (0.05 + (name == "high") for name in each.mode.split("-"))
        assert each.state["T"] == pytest.approx(first, abs=1e-12)
        assert each.state["U"] == pytest.approx(second, abs=1e-12)
        assert each.stable
        options = mi.Options(engine="interpreted", method="dop853")
        run = mi.simulate(room, duration=1.0, initial=each.state, options=options)
        assert run.final.mode == each.mode
        assert run.events.empty


def bent(mode, t, y, p):
    return (p.m - 3.0 * y.x if y.x < 0.2 else p.m - 0.6 - 50.0 * (y.x - 0.2),)


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-12])
def test_an_eigenvalue_beside_a_kink_is_that_of_its_side(distance):
    (found,) = mi.find_equilibria(one_state(bent, m=0.6 - 3.0 * distance), guess={"x": 0.1})
    assert found.state.x == pytest.approx(0.2 - distance, abs=1e-15)
    assert found.eigenvalues.tolist() == [-3.0]


@pytest.mark.parametrize("power", [2, 3, 5])
def test_a_zero_eigenvalue_is_no_continuum(power):
    flow = {
        2: lambda mode, t, y, p: (p.a * y.x**2,),
        3: lambda mode, t, y, p: (p.a * y.x**3,),
        5: lambda mode, t, y, p: (p.a * y.x**5,),
    }[power]
    (found,) = mi.find_equilibria(one_state(flow, a=-7.0), guess={"x": 0.0})
    assert found.eigenvalues.tolist() == [0.0]
    assert found.stable is None


def one_sided_damping(mode, t, y, p):
    return y.v, -y.x - (p.above if mode.side == 1 else p.below) * y.v


@pytest.mark.parametrize(("above", "below"), [(0.1, -0.3), (-0.1, 0.3)])
def test_one_side_of_a_boundary_does_not_decide_stability(above, below):
    """Per turn the amplitude grows by exp(-pi/2 (above + below)), roughly."""
    oscillator = mi.System(
        states=("x", "v"), flow=one_sided_damping, initial={"x": 0.5}, time_scale=1.0,
        parameters={"above": above, "below": below}, parts=[mi.SwitchingSurface("side", "x")],
    )  # fmt: skip
    (rest,) = mi.find_equilibria(oscillator)
    assert rest.boundaries == ("side",)
    assert rest.stable == (above > 0.0)
    assert " in its mode, on the boundary 'side', State(" in repr(rest)
    options = mi.Options(engine="interpreted")
    final = mi.simulate(oscillator, duration=30.0, options=options).final
    assert (math.hypot(final.x, final.v) > 0.5) == (above + below < 0.0)


def pulled(mode, t, y, p):
    return ((p.a - 3.0 * y.x) * (1.0 if mode.side == 1 else 2.0),)


def test_an_equilibrium_that_stays_on_a_boundary_does_not_cross_it():
    """Its margin is zero up to rounding, of either sign."""
    system = mi.System(
        states=("x",), flow=pulled, parameters={"a": 0.1}, time_scale=1.0,
        parts=[mi.SwitchingSurface("side", lambda t, y, p: y.x - p.a / 3.0)],
    )  # fmt: skip
    rest = mi.find_equilibria(system)[0]
    branch = mi.continue_solution(rest, "a", stop=2.0)
    assert branch.ended == "a reached its bound"
    assert not branch.special_points
    assert all(each.boundaries == ("side",) for each in branch.equilibria)


def test_without_equilibria_the_message_names_a_state_of_the_system():
    driven = mi.System(states=("th",), flow=lambda mode, t, y, p: (1.0 + y.th**2,))
    with pytest.raises(mi.OrbitError, match=r"box=\{'th': \(low, high\)\}"):
        mi.find_equilibria(driven)
