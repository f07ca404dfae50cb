"""DifferentialEquations.jl #703: a clock's verge escapement, whose solver is trapped at one time.

Numbers and the thirty gaps are the thread's, as corrected there; which tooth may meet which pallet,
a matter of its callback, is what the modes say here. The thread's angle between the pallets makes
the limit cycle a closed form: teeth strike where they point along their pallet, a beat apart.
"""

import math

import numpy as np
import pytest

import mems_impact as mi

TEETH, TORQUE, CROWN, VERGE, R_C, R_V, E = 15, 1.0, 10.0, 0.15, 1.0, 0.3, 0.05
PITCH = 2.0 * math.pi / TEETH
M_V, M_C = VERGE / R_V**2, CROWN / R_C**2
G_C, G_V = M_V * (1.0 + E) / R_C / (M_V + M_C), M_C * (1.0 + E) / R_V / (M_V + M_C)
BETWEEN = G_V * R_C / (1.0 - E) * PITCH / 2.0  # of the pallets
BEAT = math.sqrt(PITCH * R_C * CROWN * G_C / (TORQUE * (1.0 - E)))
CLOSING = TORQUE * BEAT / (CROWN * G_C)  # how fast tooth and pallet meet

# Modes: what is met next. Upper tooth k is at the pallet at the crown's angle k PITCH, lower tooth
# k half a pitch later.
MODES = mi.modes(*(f"{side} {k}" for k in range(TEETH) for side in ("upper", "lower")))


def strike(side, k):
    """Return the guard between tooth k and the upper (1) or lower (-1) pallet."""
    own = 2 * k + (0 if side > 0 else 1)
    here = k * PITCH + (0.0 if side > 0 else 0.5 * PITCH)
    after = (own + 1) % (2 * TEETH)

    def gap(mode, t, y, p):
        leaning = side * y.verge + 0.5 * p.between
        return p.r_v * math.sin(leaning) - p.r_c * math.sin(y.crown - here) * math.cos(leaning)

    def blow(mode, t, y, p):
        closing = p.r_c * y.turning - side * p.r_v * y.swinging
        speeds = y.turning - p.g_c * closing, y.swinging + side * p.g_v * closing
        return after, (y.crown, y.verge, *speeds)

    return mi.Impact(f"{'upper' if side > 0 else 'lower'} {k}", gap, blow, modes=(own, after))


CLOCK = mi.System(
    states=("crown", "verge", "turning", "swinging"),
    flow=lambda mode, t, y, p: (y.turning, y.swinging, p.torque / p.crown, 0.0),
    parameters={
        "torque": TORQUE, "crown": CROWN, "r_c": R_C, "r_v": R_V, "g_c": G_C, "g_v": G_V,
        "between": BETWEEN,
    },
    guards=[strike(side, k) for side in (1, -1) for k in range(TEETH)],
    modes=MODES,
)  # fmt: skip


def started(faster=1.0):
    """Return the limit cycle's state before the upper pallet meets tooth 0, all speeds changed."""
    turning = CLOSING * (1.0 - 0.5 * R_V * G_V) / R_C
    return mi.State(
        crown=0.0, verge=-0.5 * BETWEEN, turning=faster * turning,
        swinging=-faster * 0.5 * G_V * CLOSING, mode="upper 0",
    )  # fmt: skip


@pytest.fixture(params=["dop853", pytest.param("adams", marks=pytest.mark.slow)])
def options(request):
    # Thirty guards whose rates are differences take 20 s to compile: not here.
    return mi.Options(engine="interpreted", method=request.param)


def test_thirty_guards_and_a_tooth_in_two_beats():
    assert len(CLOCK.automaton.guards) == 30
    assert run_of_the_crown() == pytest.approx(PITCH, rel=1e-14)


def run_of_the_crown():
    """Return how far the crown turns in two beats of the limit cycle."""
    slow = started().turning - G_C * CLOSING
    return 2.0 * (slow * BEAT + 0.5 * TORQUE / CROWN * BEAT**2)


def test_the_clock_ticks_for_two_turns(options):
    run = mi.simulate(CLOCK, duration=59.5 * BEAT, initial=started(), options=options)
    assert len(run.impacts) == 60
    assert run.impacts["t"].to_numpy() == pytest.approx(BEAT * np.arange(60), abs=1e-7)
    assert run.impacts["event"].iloc[:4].tolist() == ["upper 0", "lower 0", "upper 1", "lower 1"]
    # The saw-tooth of the crown's speed.
    before, after = run.impacts["turning before"], run.impacts["turning after"]
    fast = CLOSING * (1.0 - 0.5 * R_V * G_V) / R_C
    assert before.to_numpy() == pytest.approx(fast, rel=1e-6)
    assert after.to_numpy() == pytest.approx(fast - G_C * CLOSING, rel=1e-6)


@pytest.mark.parametrize("faster", [0.97, 1.03])
def test_the_clock_finds_its_beat(faster, options):
    run = mi.simulate(CLOCK, duration=60.0 * BEAT, initial=started(faster), options=options)
    assert np.diff(run.impacts["t"].iloc[-10:]) == pytest.approx(BEAT, rel=1e-7)
