"""What holds in modes that a user has written: multipliers, exponents and equilibria know it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.hybrid.variational.derivatives import Variational

TIGHT = mi.Options(engine="interpreted", method="dop853", rtol=1e-10, atol=1e-12)
FREE, JOINED = mi.modes("free", "joined")


def bodies(mode, t, y, p):
    """Flow of a shaken oscillator beside a body of the same mass, alone or joined for good."""
    pull = -p.k * y.x - p.c * y.v + p.A * math.cos(t)
    if mode == JOINED:
        return y.v, 0.5 * pull, y.w, 0.5 * pull
    return y.v, pull, y.w, 0.0


def apart(mode, t, y, p):
    return y.z - y.x


def parting(mode, t, y, p):
    return y.w - y.v


def join(mode, t, y, p):
    speed = 0.5 * (y.v + y.w)
    return JOINED, (y.x, speed, y.x, speed)


def joined(**more):
    given = {
        "parameters": {"k": 1.0, "c": 0.2, "A": 0.3},
        "initial": mi.State(x=0.5, z=0.5, mode="joined"),
        "constraints": {JOINED: (apart, parting)},
        **more,
    }
    return mi.System(
        states=("x", "v", "z", "w"),
        flow=bodies,
        period=2.0 * math.pi,
        guards=[mi.Guard("meet", apart, join, modes=(FREE,))],
        **given,
    )


MU = math.exp(-0.05 * 2.0 * math.pi)  # one oscillator of mass 2, damping 0.2


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_multipliers_of_an_orbit_in_a_mode_held_for_good(engine):
    options = replace(TIGHT, engine=engine)
    orbit = mi.find_orbit(joined(), transient=60, options=options)
    assert orbit.stable
    sizes = sorted(np.abs(orbit.multipliers))
    assert sizes == pytest.approx([0.0, 0.0, MU, MU], abs=1e-8)


def test_the_distance_held_is_a_parameter():
    """Whatever the motion, its derivative keeps to the constraint, as differences of motions do."""
    system = joined(
        parameters={"k": 1.0, "c": 0.2, "A": 0.3, "length": 0.4},
        initial=mi.State(x=0.5, z=0.9, mode="joined"),
        constraints={JOINED: (lambda mode, t, y, p: y.z - y.x - p.length, parting)},
    )
    family = system.family(TIGHT)
    directions = family.at().derivative("length")[0][None]
    start = np.array([0.5, 0.0, 0.9, 0.0])
    arc = Variational(family.problem(), directions).arc(JOINED, start, 0.0, 2.0)
    x, v, z, w = arc.by_parameter[:, 0]
    assert (z - x, w - v) == pytest.approx((1.0, 0.0), abs=1e-9)


def test_an_equilibrium_on_a_surface_that_bends_is_isolated():
    def around(mode, t, y, p):  # on the circle to the angle 1, where the other one is unstable
        turn = p.a * (math.sin(1.0) * y.x - math.cos(1.0) * y.y)
        return -turn * y.y, turn * y.x

    def circle(mode, t, y, p):
        return y.x * y.x + y.y * y.y - p.r * p.r

    ring = mi.System(
        states=("x", "y"),
        flow=around,
        modes=("slides",),
        parameters={"a": 3.0, "r": 2.0},
        initial={"x": 2.0},
        time_scale=1.0,
        constraints={"slides": circle},
    )
    (found,) = mi.find_equilibria(ring, guess={"x": 1.5, "y": 1.5})
    assert found.stable
    assert found.nullity == 0
    assert found.state.x == pytest.approx(2.0 * math.cos(1.0), abs=1e-10)
    assert found.state.y == pytest.approx(2.0 * math.sin(1.0), abs=1e-10)
    assert found.eigenvalues == pytest.approx([-6.0], abs=1e-7)


@pytest.mark.parametrize("slope", [1.0, 1e3, 1e6])
def test_equilibria_around_a_pipe_are_a_continuum_however_steep_the_flow_is_beside_it(slope):
    def along(mode, t, y, p):
        beside = p.slope * (y.x * y.x + y.y * y.y - 4.0)
        return beside, 2.0 * beside, -y.z

    pipe = mi.System(
        states=("x", "y", "z"),
        flow=along,
        modes=("slides",),
        parameters={"slope": slope},
        initial={"x": 2.0 * math.cos(1.0), "y": 2.0 * math.sin(1.0), "z": 0.1},
        time_scale=1.0,
        constraints={"slides": lambda mode, t, y, p: y.x * y.x + y.y * y.y - 4.0},
    )
    (found,) = mi.find_equilibria(pipe)
    assert (found.stable, found.nullity) == (True, 1)
    assert found.eigenvalues == pytest.approx([-1.0], abs=1e-9)


@pytest.mark.parametrize(
    ("constraint", "message"),
    [
        (lambda mode, t, y, p: y.x - y.z - 0.1, "is -0.1 at x = 0.5.* must be zero"),
        (lambda mode, t, y, p: y.x - 0.5, "changes at the rate .* must remain zero"),
    ],
    ids=["not zero", "not kept"],
)
def test_what_does_not_hold_is_refused(constraint, message):
    with pytest.raises(mi.FunctionError, match=message):
        joined(
            constraints={JOINED: constraint}, initial=mi.State(x=0.5, v=1, z=0.5, w=1, mode=JOINED)
        )


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"constraints": {2: apart}}, "constraints"),
        ({"constraints": {"welded": apart}}, "free, joined"),
        ({"constraints": apart}, "mapping of modes"),
        ({"constraints": {JOINED: lambda y: y.x}}, "takes 1 arguments"),
    ],
)
def test_what_is_no_constraint_is_refused(more, message):
    with pytest.raises(mi.InvalidParameter, match=message):
        joined(**more)
    with pytest.raises(mi.InvalidParameter, match="parts"):
        mi.System(
            states=("x", "v"),
            flow=lambda mode, t, y, p: (y.v, -y.x),
            parts=[mi.Friction("ground", "v", mu=0.5)],
            constraints={0: apart},
        )


def test_a_state_is_projected_in_any_units():
    """A curve of some micrometres, on which the step of a difference would be long."""

    def wave(mode, t, y, p):
        return 1e-6 * math.sin(1e6 * y.x) - y.z

    slider = mi.System(
        states=("x", "z"), flow=lambda mode, t, y, p: (1e-6, 1e-6 * math.cos(1e6 * y.x)),
        constraints={0: wave}, time_scale=1.0,
    )  # fmt: skip
    automaton = slider.automaton
    p = slider.numbers().parameters
    beside = np.array([0.5e-6, 1e-6 * math.sin(0.5) + 1e-8])
    _, onto = automaton.state_after(0, automaton.projection_code, 0.0, beside, p)
    x, z = 1e6 * onto
    assert z == pytest.approx(math.sin(x), rel=1e-12)
    # The nearest point: the step is normal to the curve.
    assert (x - 0.5) + math.cos(x) * (z - 1e6 * beside[1]) == pytest.approx(0.0, abs=1e-4)
