"""Persistence and nonsmooth folds at boundary equilibria, against Feigin's rules in closed form.

di Bernardo, Budd, Champneys and Kowalczyk, Piecewise-smooth Dynamical Systems (2008), theorems 5.1
and 5.2.
"""

import numpy as np
import pytest

import mems_impact as mi

FIELD = np.array([[-1.0, -1.0], [1.0, -0.5]])  # N
DRIVE = np.array([0.3, 1.0])  # M


def bent(mode, t, y, p):
    kink = p.c * y.z if mode.line == -1 else 0.0
    return -y.x - y.z + 0.3 * p.a + p.d * kink, y.x - 0.5 * y.z + p.a + kink


def cut(mode, t, y, p):
    if mode.line == 1:
        return -y.x - y.z + 0.3 * p.a, y.x - 0.5 * y.z + p.a
    return p.c, p.d


def boundary(flow, **parameters):
    """Return the boundary equilibrium of the upper field, at a = 0."""
    system = mi.System(
        states=("x", "z"),
        flow=flow,
        parameters={"a": 1.0, **parameters},
        parts=[mi.SwitchingSurface("line", "z")],
    )
    (above,) = mi.find_equilibria(system, modes=["above"])
    (special,) = mi.continue_solution(above, "a", -1.0).special_points
    assert (special.kind, special.guard) == ("boundary equilibrium", "line")
    assert abs(special.value) < 1e-10
    return special


@pytest.mark.parametrize(
    ("c", "d", "kind"), [(-2.0, 0.4, "persistence"), (2.0, 0.4, "nonsmooth fold")]
)
def test_continuous_field(c, d, kind):
    found = boundary(bent, c=c, d=d).type
    jump = np.array([d * c, c])  # E
    number = 1.0 + np.linalg.solve(FIELD, jump)[1]
    assert found == kind
    assert abs(found.criterion - number) < 1e-8
    ratio = np.linalg.det(FIELD + np.outer(jump, [0.0, 1.0])) / np.linalg.det(FIELD)
    assert abs(ratio - number) < 1e-12
    assert abs(found.slopes[0] + np.linalg.solve(FIELD, DRIVE)[1]) < 1e-9
    assert found.modes == ("above", "below")
    assert abs(found.other.eigenvalues.prod() - ratio * np.linalg.det(FIELD)) < 1e-8


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("c", "d", "kind"), [(0.5, 1.0, "persistence"), (-2.0, 1.0, "nonsmooth fold")]
)
def test_filippov_system(c, d, kind):
    special = boundary(cut, c=c, d=d)
    found = special.type
    # The margin of sliding is -C^T f+ = C^T E times the weight of the lower field.
    number = -np.linalg.solve(FIELD, [c, d])[1] / d
    assert found == kind
    assert abs(found.criterion - number) < 1e-8
    assert found.modes == ("above", "sliding")

    # Brute force: where each of the two equilibria is admissible.
    def exists(mode, a):
        system = special.system.changed(a=a)
        return any(each.admissible for each in mi.find_equilibria(system, modes=[mode]))

    sides = [(exists("above", a), exists("sliding", a)) for a in (-0.05, 0.05)]
    persists = {(True, False), (False, True)}
    assert set(sides) == (persists if kind == "persistence" else {(True, True), (False, False)})


def test_from_the_sliding_branch():
    special = boundary(cut, c=0.5, d=1.0)
    begin = special.system.changed(a=-0.1)
    (sliding,) = mi.find_equilibria(begin, modes=["sliding"])
    branch = mi.continue_solution(sliding, "a", 0.1)
    assert branch.special_table["type"].tolist() == ["persistence"]
    (met,) = branch.special_points
    found, other = met.type, special.type
    assert found == "persistence"
    assert found.modes == ("sliding", "above")
    assert abs(found.criterion * other.criterion - 1.0) < 1e-7


def test_contact_that_holds():
    """A pulled body meets a stopper, and rests on it beyond."""
    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, p.pull - y.x - 0.5 * y.v),
        parameters={"pull": 0.5},
        parts=[mi.Stopper("wall", "x", "v", upper=1.0, restitution=0.5)],
    )
    (free,) = mi.find_equilibria(system, modes=["free"])
    met = mi.continue_solution(free, "pull", 1.5).special_points[0]
    found = met.type
    assert found == "persistence"
    assert found.modes[0] == "free"


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["right", "left"])
def test_the_mode_that_contact_leads_to(side):
    """A spring that overload hardens has the same equilibrium there, but no contact leads to it."""
    free, pressed, hard = mi.modes("free", "pressed", "hard")
    stiffness = {free: 0.0, pressed: 2.0, hard: 9.0}

    def flow(mode, t, y, p):
        return y.v, p.pull - y.x - 0.5 * y.v - stiffness[mode] * (y.x - side)

    def depth(mode, t, y, p):
        return side * y.x - 1.0

    system = mi.System(
        states=("x", "v"),
        flow=flow,
        parameters={"pull": 0.5 * side},
        guards=[
            mi.Guard(
                "contact", lambda mode, t, y, p: 1.0 - side * y.x,
                lambda mode, t, y, p: (pressed if side * y.v > 0.0 else free, (side, y.v)),
                modes=(free,),
            ),
            mi.Guard("release", depth, lambda mode, t, y, p: (free, (side, y.v)),
                     modes=(pressed, hard)),
            mi.Guard("overload", lambda mode, t, y, p: 2.0 - side * y.x,
                     lambda mode, t, y, p: (hard, (y.x, y.v)), modes=(pressed,)),
        ],
    )  # fmt: skip
    (rest,) = mi.find_equilibria(system, modes=["free"])
    (met,) = mi.continue_solution(rest, "pull", 1.5 * side).special_points
    found = met.type
    assert (found, found.modes) == ("persistence", ("free", "pressed"))


def test_what_has_no_type():
    def bounce(mode, t, y, p):
        return mode, (1.0, -0.5 * y.v)

    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, p.pull - y.x - y.v),
        parameters={"pull": 0.5},
        guards=[mi.Impact("wall", lambda mode, t, y, p: 1.0 - y.x, bounce)],
    )
    (free,) = mi.find_equilibria(system)
    (met,) = mi.continue_solution(free, "pull", 2.0).special_points
    with pytest.raises(mi.OrbitError, match="no other mode"):
        _ = met.type
    parabola = mi.System(
        states=("x",), flow=lambda mode, t, y, p: (p.a - y.x**2,), parameters={"a": 1.0}
    )
    (upper,) = mi.find_equilibria(parabola, guess={"x": 1.2})
    (fold,) = mi.continue_solution(upper, "a", -0.5).special_points
    assert fold.type is None
