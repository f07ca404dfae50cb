import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import mems_impact as mi
from mems_impact.actuator.impact_statistics import contact_time
from mems_impact.actuator.model import compose
from mems_impact.actuator.terms import CompliantStopper

ZHAO = mi.load_actuator("zhao2004")
SILENT = mi.Sine(amplitude=1e-9, omega=0.5)
PRECISE = mi.Options(engine="interpreted", method="dop853", rtol=1e-11, atol=1e-13)


def restitution(damping, speed):
    """The implicit relation of Hunt and Crossley's law, whatever the exponent."""
    b = 1.5 * damping

    def balance(after):
        return b * (speed + after) - math.log1p(b * speed) + math.log1p(-b * after)

    return brentq(balance, 0.0, (1.0 - 1e-15) / b, xtol=1e-15) / speed


@pytest.mark.parametrize("exponent", [1.0, 1.5])
@pytest.mark.parametrize("speed", [0.01, 0.2, 1.0, 3.0])
def test_restitution(exponent, speed):
    free = ZHAO.replace(k=1e-6, c=0.0, mu_s=1e6)  # nothing but the contact acts
    hard = free.adding(CompliantStopper(stiffness=1e3, exponent=exponent, damping=0.4))
    start = mi.State(x2=0.5, v2=speed)
    run = mi.simulate(hard, SILENT, duration=1.2, initial=start, options=PRECISE)
    leaving = run.events.query("event == 'release'")["v2"].iloc[0]
    assert run.events["mode after"].iloc[0] == "stuck-free"
    assert -leaving / speed == pytest.approx(restitution(0.4, speed), rel=1e-6)
    if speed == 0.01:
        assert -leaving / speed == pytest.approx(1.0 - 0.4 * speed, abs=2.0 * (0.4 * speed) ** 2)


def test_what_a_contact_stores():
    # A run that ends within a contact: motion, springs and what is lost make up the beginning.
    soft = ZHAO.replace(c=0.0, mu_s=1e6).adding(
        CompliantStopper(stiffness=300.0, exponent=1.5, damping=0.5, depth=0.1)
    )
    run = mi.simulate(soft, SILENT, duration=0.6, initial=mi.State(v2=1.0), options=PRECISE)
    part = compose((soft.terms[0].kind,), 1).contributions[0]
    y, p = run.trajectory.final.y, run.trajectory.problem.parameters
    assert y[2] > 0.53
    assert part.dissipation(y, p) > 0.0
    assert part.energy(y, p) > 0.05
    total = 0.5 * y[3] ** 2 + 0.5 * y[2] ** 2 + part.energy(y, p) + y[4]
    assert total == pytest.approx(0.5, rel=1e-9)


@pytest.mark.parametrize("eps", [1e-3, 1e-5, 1e-7, 1e-9])
def test_a_graze_is_a_contact(eps):
    # The free block has the amplitude 0.5 + eps, and is at the face at sqrt(2 eps 0.5).
    soft = ZHAO.replace(c=0.0).adding(CompliantStopper(stiffness=1e3, exponent=1.5))
    start = mi.State(v2=0.5 + eps)
    run = mi.simulate(soft, SILENT, duration=2.5, initial=start, options=PRECISE)
    assert list(run.events["event"]) == ["right impact", "release"]
    slow = math.sqrt((0.5 + eps) ** 2 - 0.25)
    assert run.impacts["v2 before"].iloc[0] == pytest.approx(slow, rel=1e-4 + 1e-11 / eps)
    clear = mi.simulate(soft, SILENT, duration=2.5, initial=mi.State(v2=0.5 - eps), options=PRECISE)
    assert clear.events.empty


def test_the_block_starts_and_rests_in_a_contact():
    # 0.4 V hold it: the depth at which stopper, spring and electrode balance.
    soft = ZHAO.adding(CompliantStopper(stiffness=1e3, exponent=1.5, damping=0.5))

    def unbalanced(depth):
        return 0.16 / (0.5 - depth) ** 2 - 0.5 - depth - 1e3 * depth**1.5

    deep = brentq(unbalanced, 0.0, 0.1)
    held = mi.Pulse(amplitude=0.4, period=20.0, width=10.0, phase=0.0)
    start = mi.State(x2=0.5 + deep)
    run = mi.simulate(soft, held, duration=9.0, initial=start, options=PRECISE)
    assert set(run.events["mode after"]) <= {"stuck-right"}
    assert run.final.x2 == pytest.approx(0.5 + deep, abs=1e-12)
    face = mi.simulate(soft, held, duration=9.0, initial=mi.State(x2=0.5), options=PRECISE)
    assert set(face.events["mode after"]) == {"stuck-right"}
    assert face.final.x2 == pytest.approx(0.5 + deep, abs=1e-3)
    off = mi.simulate(soft, SILENT, duration=0.5, initial=mi.State(x2=0.5), options=PRECISE)
    assert off.events.empty
    assert off.final.x2 < 0.45


def test_a_mode_must_fit():
    soft = ZHAO.adding(CompliantStopper(stiffness=1e3))
    for state in (mi.State(x2=0.4, mode="stuck-right"), mi.State(x2=0.51, mode="stuck-free"),
                  mi.State(x2=0.51, v1=0.1, mode="backward-right")):  # fmt: skip
        with pytest.raises(mi.InvalidParameter, match="does not fit"):
            mi.simulate(soft, SILENT, periods=1, initial=state)


def test_a_block_starts_before_the_electrode():
    soft = ZHAO.adding(CompliantStopper(stiffness=1e3))
    with pytest.raises(mi.InvalidParameter, match=r"halfway .* at -0.75 and 0.75"):
        mi.simulate(soft, SILENT, periods=1, initial=mi.State(x2=0.8))


@pytest.mark.slow
def test_bounces_that_end_in_rest_are_one_blow():
    # Pressed by 0.45 V from near by, the block bounces and comes to rest; then it is let go.
    soft = ZHAO.adding(CompliantStopper(stiffness=1e3, damping=1.5))
    held = mi.Pulse(amplitude=0.45, period=26.0, width=16.0)
    run = mi.simulate(
        soft, held, periods=1, initial=mi.State(x2=0.4), options=PRECISE, window=(0, 1)
    )
    first = run.blows.iloc[0]
    assert len(run.impacts) == first["impacts"] > 3
    assert first["ends in rest"]
    assert run.statistics["chatter sequences"] == run.statistics["blows"] == 1
    assert first["energy lost"] == pytest.approx(run.impacts["energy lost"].sum(), rel=1e-12)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
def test_contact_time(exponent):
    soft = ZHAO.adding(CompliantStopper(stiffness=50.0, exponent=exponent, depth=0.1))
    factor, power = 50.0 / 0.1 ** (exponent - 1.0), exponent + 1.0
    deepest = (0.5 * power * 0.09 / factor) ** (1.0 / power)

    def slowness(angle):  # depth = deepest * (1 - angle^2), which takes the pole away
        u = 1.0 - angle * angle
        return (
            2.0 * angle * deepest / math.sqrt(0.09 - 2.0 * factor / power * (deepest * u) ** power)
        )

    exact = 2.0 * quad(slowness, 0.0, 1.0)[0]
    assert contact_time(soft, np.array([0.3, 0.0])) == pytest.approx([exact, 0.0], rel=1e-8)
