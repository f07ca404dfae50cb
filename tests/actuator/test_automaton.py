"""Modes and transitions of the actuator: rest contact, slips and break-away."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator import equations as eq
from mems_impact.actuator.automaton import (
    BACKWARD,
    BREAK_AWAY,
    FORWARD,
    FREE,
    LEFT,
    RELEASE,
    RIGHT,
    RIGHT_IMPACT,
    SLIP_END,
    STUCK,
    mode_of,
    side_of,
)
from mems_impact.actuator.drives import Sine
from mems_impact.hybrid.event_loop import workspace
from tests.actuator.machine import ZHAO, mode_of_state, parameters, simulate

DELTA, D = ZHAO.delta, ZHAO.d
HOLDING = math.sqrt(ZHAO.k * DELTA / ZHAO.alpha) * (D - DELTA)  # 0.3536
ENGINES = ("compiled", "interpreted")
NOTHING = Sine(amplitude=0.0, omega=1.0)


@pytest.mark.parametrize(
    ("mu", "y", "voltage", "expected"),
    [
        # The frame: moving, held, or torn away by the load k x2 = +-0.5.
        (0.4, (0, 0.0, 0.0, 0.0), 0.0, (STUCK, FREE)),
        (0.4, (0, 0.1, 0.0, 0.0), 0.0, (FORWARD, FREE)),
        (0.4, (0, -0.1, 0.0, 0.0), 0.0, (BACKWARD, FREE)),
        (0.001, (0, 0.0, 0.4, 0.0), 0.0, (FORWARD, FREE)),
        (0.001, (0, 0.0, -0.4, 0.0), 0.0, (BACKWARD, FREE)),
        (0.001, (0, -1e-9, 0.4, 0.0), 0.0, (BACKWARD, FREE)),
        (0.0, (0, 0.0, 0.0, 0.0), 0.0, (STUCK, FREE)),
        (0.0, (0, 0.0, 1e-12, 0.0), 0.0, (FORWARD, FREE)),
        # The block on a stopper: pressed, let go, or in motion.
        (0.4, (0, 0.0, DELTA, 0.0), 0.36, (STUCK, RIGHT)),
        (0.4, (0, 0.0, DELTA, 0.0), 0.35, (STUCK, FREE)),
        (0.4, (0, 0.0, DELTA, 1e-12), 0.36, (STUCK, FREE)),
        (0.4, (0, 0.0, DELTA - 1e-12, 0.0), 0.36, (STUCK, FREE)),
        (0.4, (0, 0.0, -DELTA, 0.0), 0.36, (STUCK, FREE)),
        # A sliding frame is braked; the block presses on its right stopper with m2 mu_d g more.
        (0.4, (0, 0.1, DELTA, 0.0), 0.0, (FORWARD, RIGHT)),
        (0.4, (0, -0.1, DELTA, 0.0), 0.36, (BACKWARD, FREE)),
        (0.4, (0, -0.1, -DELTA, 0.0), 0.0, (BACKWARD, LEFT)),
        (0.4, (0, 0.1, -DELTA, 0.0), 0.0, (FORWARD, FREE)),
        # Held by the stopper the load is internal: even a frame on ice stays.
        (0.001, (0, 0.0, DELTA, 0.0), 0.38, (STUCK, RIGHT)),
    ],
)
def test_mode_under_a_force(mu, y, voltage, expected):
    actuator = ZHAO.replace(mu_s=mu, mu_d=min(mu, ZHAO.mu_d))
    drive = Sine(amplitude=0.0, omega=1.0, bias=voltage)
    assert mode_of_state(actuator, drive, y) == mode_of(*expected)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "f", "omega"),
    [
        ("compiled", 0.36, 0.2),
        ("compiled", 0.38, 0.05),
        ("compiled", 0.384, 0.5),
        ("interpreted", 0.384, 0.5),
    ],
)
def test_release_of_a_resting_block(f, omega, engine):
    """Released where f cos(omega t) falls to what holds the spring."""
    drive = Sine(amplitude=f, omega=omega)
    run_ = simulate(ZHAO, drive, [0.0, 0.0, DELTA, 0.0], 0.3, engine=engine)
    first = run_.events[0:1]
    assert (first.kind[0], first.guard[0]) == (workspace.TRANSITION, RELEASE)
    assert first.mode_before[0] == mode_of(STUCK, RIGHT)
    assert first.time[0] == pytest.approx(math.acos(HOLDING / f) / omega, abs=1e-12)
    assert first.after[0].tolist() == [0.0, 0.0, DELTA, 0.0]
    assert np.all(run_.events.kind[1:] != workspace.TRANSITION)  # it leaves for good
    assert run_.final.y[2] < DELTA


@pytest.mark.parametrize(
    "engine", ["compiled", pytest.param("interpreted", marks=pytest.mark.slow)]
)
def test_chatter_ends_in_rest_contact_and_rest_in_release(engine):
    """Started close to the stopper, at the crest of a drive that holds it."""
    drive = Sine(amplitude=0.38, omega=0.02)
    run_ = simulate(ZHAO, drive, [0.0, 0.0, 0.45, 0.0], 0.3, engine=engine)
    events = run_.events
    rests = np.flatnonzero(events.kind == workspace.ACCUMULATION)
    assert rests.size == 1
    assert side_of(int(events.mode_after[rests[0]])) == 1
    assert events.after[rests[0], 2:].tolist() == [DELTA, 0.0]
    released = events[(events.kind == workspace.TRANSITION) & (events.guard == RELEASE)]
    assert released.time == pytest.approx([math.acos(HOLDING / 0.38) / 0.02], abs=1e-10)
    samples = run_.samples(2000)
    assert np.abs(samples.y[:, 2]).max() <= DELTA + 1e-9
    resting = samples.mode >= 3
    assert np.all(samples.y[resting, 2] == DELTA)


def test_a_drive_that_never_lets_go():
    drive = Sine(amplitude=0.05, omega=1.0, bias=0.5)
    run_ = simulate(ZHAO, drive, [0.0, 0.0, 0.0, 0.0], 30.0)
    assert run_.final.mode == mode_of(STUCK, RIGHT)
    assert run_.final.y[2:].tolist() == [DELTA, 0.0]
    assert len(run_.events) < 200


@pytest.mark.quick(3)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("side", "v1"), [(RIGHT, 0.3), (LEFT, -0.3)])
def test_resting_while_sliding(side, v1, engine):
    """A frame that is braked carries the block on its stopper; both stop, then the block leaves."""
    x2 = DELTA if side == RIGHT else -DELTA
    run_ = simulate(ZHAO, NOTHING, [0.0, v1, x2, 0.0], 0.1, engine=engine)
    braking = ZHAO.mu_d * ZHAO.g
    end = run_.events[0:1]
    assert end.guard[0] == SLIP_END
    assert end.time[0] == pytest.approx(abs(v1) / braking, abs=1e-11)
    assert end.after[0, 0] == pytest.approx(v1 * abs(v1) / (2.0 * braking), abs=1e-11)
    assert end.mode_after[0] == mode_of(STUCK, FREE)
    assert abs(run_.final.y[2]) < DELTA


@pytest.mark.parametrize("m2", [1.0, 20.0])
@pytest.mark.parametrize("e", [0.5, 0.8])
def test_a_frame_that_slides_through_a_chatter_keeps_its_momentum(m2, e):
    """The ground alone brakes the centre of mass, whatever the bodies do to each other."""
    actuator = ZHAO.replace(mu_s=0.002, mu_d=0.002, m2=m2, e=e)
    drive = Sine(amplitude=0.0, omega=0.1, bias=0.5)
    v1, x2, v2, time = 0.3, 0.45, 0.2, 12.0
    run_ = simulate(actuator, drive, [0.0, v1, x2, v2], time / drive.period, rtol=1e-13, atol=1e-15)
    slip = (run_.events.kind == workspace.TRANSITION) & (run_.events.guard == SLIP_END)
    assert run_.final.mode == mode_of(FORWARD, RIGHT)
    assert not slip.any()
    part, braking = m2 / (actuator.m1 + m2), actuator.mu_d * actuator.g
    place = part * x2 + (v1 + part * v2) * time - 0.5 * braking * time**2
    assert run_.final.y[0] + part * DELTA == pytest.approx(place, abs=2e-13)


def test_ratio_of_successive_impacts_of_a_chatter():
    """It is not e - (1 + e) m2/(m1 + m2) alone: the wall moves while the frame slips.

    With kappa = (1 + e) m2/(m1 + m2), F the friction of the ground and a the closing
    acceleration, the exact ratio for constant forces is its square plus kappa^2 a m1/(F + m2 a),
    under the root.
    """
    drive = Sine(amplitude=0.38, omega=1e-3)  # as good as constant
    events = simulate(ZHAO, drive, [0.0, 0.0, 0.45, 0.0], 0.1, rtol=1e-12, atol=1e-15).events
    hits = events[(events.kind == workspace.TRANSITION) & (events.guard == RIGHT_IMPACT)]
    speeds = hits.before[:, 3]
    ratios = speeds[1:] / speeds[:-1]
    kappa = (1.0 + ZHAO.e) * ZHAO.m2 / (ZHAO.m1 + ZHAO.m2)
    a = (eq.attraction(DELTA, 0.38, parameters()) - ZHAO.k * DELTA) / ZHAO.m2
    friction = ZHAO.mu_d * (ZHAO.m1 + ZHAO.m2) * ZHAO.g
    rough = ZHAO.e - kappa
    exact = math.sqrt(rough**2 + kappa**2 * a * ZHAO.m1 / (friction + ZHAO.m2 * a))
    assert len(ratios) > 5
    assert ratios[-5:] == pytest.approx(exact, rel=1e-3)
    assert exact == pytest.approx(0.5, abs=5e-3)


# Break-away and slips with little friction. F = mu N, N = 6 g.


def icy(mu_s, mu_d=None):
    return ZHAO.replace(mu_s=mu_s, mu_d=mu_s if mu_d is None else mu_d)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("ratio", [1.0, 0.5])
def test_break_away_exactly_at_the_static_limit(ratio, engine):
    """The block swings freely on the stuck frame until its load reaches mu_s N."""
    actuator = icy(0.004, 0.004 * ratio)
    limit = actuator.mu_s * (actuator.m1 + actuator.m2) * actuator.g
    run_ = simulate(actuator, NOTHING, [0.0, 0.0, 0.0, 0.4], 1.0, engine=engine)
    first = run_.events[0:1]
    assert first.guard[0] == BREAK_AWAY
    x2, v2 = first.before[0, 2:]
    assert abs(eq.load(x2, v2, 0.0, parameters(actuator))) == pytest.approx(limit, abs=1e-13)
    assert first.mode_after[0] == mode_of(FORWARD, FREE)
    c, decay = ZHAO.c, ZHAO.c / 2.0
    pulse = math.sqrt(1.0 - decay**2)
    t = first.time[0]
    exact = 0.4 / pulse * math.exp(-decay * t) * math.sin(pulse * t)
    assert x2 == pytest.approx(exact, abs=1e-10)
    assert c * v2 + x2 == pytest.approx(limit, abs=1e-13)


@pytest.mark.parametrize("engine", ENGINES)
def test_slip_reversal_at_zero_velocity(engine):
    """A load beyond the static limit turns the frame round without a stop."""
    actuator = icy(0.002, 0.001)
    run_ = simulate(actuator, NOTHING, [0.0, -0.02, 0.4, 0.0], 0.5, engine=engine)
    first = run_.events[run_.events.kind == workspace.TRANSITION][0:1]
    assert first.guard[0] == SLIP_END
    assert first.mode_before[0] == mode_of(BACKWARD, FREE)
    assert first.mode_after[0] == mode_of(FORWARD, FREE)
    assert first.after[0, 1] == 0.0


@pytest.mark.parametrize("engine", ENGINES)
def test_a_load_that_is_zero_to_rounding_for_a_while(engine):
    """CVODE refuses to go on (-22) where a root function stays at zero after a root."""
    actuator = ZHAO.replace(mu_s=0.0, mu_d=0.0, e=0.5, c=0.2, m1=0.2, delta=0.9)
    drive = Sine(amplitude=0.138, omega=0.0421)
    # The rate of the slip velocity is the load, and the load all but vanishes in a slow motion.
    for x2 in np.linspace(-0.3, -0.32, 3 if engine == "compiled" else 1):
        options = {"rtol": 4.8e-10, "atol": 4.8e-12, "engine": engine}
        run_ = simulate(actuator, drive, [0.0, 0.0, x2, 0.0], 1.0, **options)
        assert run_.final.cycle == 1


def test_samples_show_the_forces_of_friction_and_stoppers():
    actuator = mi.load_actuator("zhao2004")
    held = mi.Sine(amplitude=0.0, omega=0.5, bias=0.6)
    options = mi.Options(engine="interpreted", method="dop853")
    walk = mi.simulate(actuator, mi.Sine(amplitude=0.24, omega=0.5), periods=2, options=options)
    free = walk.samples(50, forces=True).query("mode == 'stuck-free'")
    volts = walk.drive.value(free["time"].to_numpy())
    pull = actuator.alpha * volts**2 / (actuator.d - free["x2"]) ** 2
    load = actuator.k * free["x2"] + actuator.c * free["v2"] - pull
    assert free["force of frame"].to_numpy() == pytest.approx(-load.to_numpy(), abs=1e-12)
    rest = mi.simulate(actuator, held, periods=20, options=options).samples(2, 19, forces=True)
    spring = actuator.k * actuator.delta
    pull = actuator.alpha * 0.6**2 / (actuator.d - actuator.delta) ** 2
    assert rest["force of block"].to_numpy() == pytest.approx(spring - pull, rel=1e-12)
