"""What the campaign found, each as the smallest case that shows it, with its story."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.automaton import GUARDS, RIGHT, STUCK, mode_of
from mems_impact.actuator.equations import V1
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.event_loop import workspace
from tests.hybrid.systems import ENGINES, INF, SQUARE, STOP, TAU, simulate, stop, times
from validation.campaign.balance import imbalance
from validation.campaign.cases import Case, hold_voltage
from validation.campaign.chatter import steady
from validation.campaign.drives import Spec
from validation.campaign.scans import TIGHT, zhao

ZHAO = mi.load_actuator("zhao2004")

MEETING = """
import ctypes, sys
import numpy as np
from mems_impact.integrators.jit.kernels import kernels
import tests.campaign.waveforms as waveforms

for name in sys.argv[1]:
    flow = kernels(*waveforms.automaton(name), 1, 1).flow
    out, y, p = np.zeros(1), np.zeros(1), np.ones(1)
    words = [ctypes.c_int64] * 2 + [ctypes.c_double] + [ctypes.c_int64] * 4
    call = ctypes.CFUNCTYPE(ctypes.c_int64, *words)(flow.address)
    call(0, 0, 2.0, y.ctypes.data, p.ctypes.data, 1, out.ctypes.data)
    print(name, out[0])
"""


@pytest.mark.nightly
def test_two_automata_from_the_cache_do_not_take_each_other_for_themselves(tmp_path):
    """Found by run 10 of the first 20 of seed 1, whose numbers were those of another drive.

    numba numbers the functions of a process to name their symbols. A sine compiled in one process
    and a user's waveform compiled in another got the same numbers; a third process that loaded
    both from the cache on disk linked the sine's equations of motion to the other's voltage,
    silently. The names now hold what no other process gives.
    """
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": os.getcwd()}

    def told(names):
        command = [sys.executable, "-c", MEETING, names]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return done.stdout.split()

    alone = told("a") + told("b")
    assert alone == ["a", "4.0", "b", "8.0"]
    assert told("ab") == alone
    assert told("ba") == ["b", "8.0", "a", "4.0"]


@pytest.mark.parametrize("engine", ENGINES)
def test_a_start_into_the_stopper_at_the_instant_of_a_switch(engine):
    """Random run 47: a burst began while the block moved into the stopper, and went through it.

    The switch came first and changed neither mode nor state; the loop took that for "nothing left
    to do" and did not look at the gap.
    """
    drive = mi.Square(amplitude=0.2, omega=0.5)
    start = mi.State(x2=0.5, v2=0.5)
    run = mi.simulate(ZHAO, drive, 0.2, initial=start, options=mi.Options(engine=engine))
    assert run.impacts["time"].iloc[0] == 0.0
    assert run.samples(200)["x2"].max() <= 0.5 * (1.0 + 1e-9)


@pytest.mark.quick(1)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_an_impact_at_the_very_end_of_an_arc(engine, e):
    """CVODE reports a root at the stop time as the stop alone: the switch must look at the gap."""
    # x = 1 - 2 cos t is at 1 when t = pi/2; there the period ends, and the wave does not change.
    p = stop(amplitude=1.0, omega=2.0, square=0.0, d=1.0, e=e)
    run = simulate(
        STOP, p, [1.0 - 1e-3, 0.5], 0.01, period=TAU, switches=SQUARE, time=TAU / 2, engine=engine
    )
    assert run.samples(2000).y[:, 0].max() <= 1.0 + 1e-9


# Nothing moves; a margin dips below zero around 0.4, and is level to the bit from 0.8 on.


def _still(mode, t, y, p, dy):
    dy[0] = 0.0


def _dip(mode, t, y, p, g, r):
    if mode == 1:
        return
    g[0] = 0.5 if t >= 0.8 else 0.5 - 0.6 * math.sin(math.pi * t / 0.8) ** 2
    turn = 2.0 * math.pi / 0.8
    r[0] = 0.0 if t >= 0.8 else -0.3 * turn * math.sin(turn * t)


def _over(mode, code, t, y, p):
    return 1


DIP = Automaton(
    states=("y",),
    modes=("before", "after"),
    guards=(Guard(name="dip", order=0),),
    flow=_still,
    margins=_dip,
    transition=_over,
)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_margin_that_dips_within_a_step_and_ends_level(engine):
    """Random runs 921 and 11497: a noisy record, at rest on the stopper; the release was missed.

    Between two samples the voltage went through zero and was level at both. The rate of the contact
    force was zero at the end of the step, to the very bit; CVODE took that for the root and
    overlooked the one in the middle. The interpreted engine had seen it, by luck: it replaces
    zeros to silence a warning. Now both do, and say why.
    """
    run = simulate(DIP, (0.0,), [0.0], 0.1, period=32.0, engine=engine)
    first = 0.8 / math.pi * math.asin(math.sqrt(0.5 / 0.6))
    assert times(run, workspace.TRANSITION)[:1] == pytest.approx([first], abs=1e-9)


@pytest.mark.nightly
@pytest.mark.parametrize("engine", ENGINES)
def test_the_end_of_a_chatter_does_not_push_the_frame_back(engine):
    """Found by the balance of momentum, off by up to 2 % in one run of eight that rested.

    The rest of a sequence of impacts is jumped over in one step of the midpoint rule. Friction
    that stops the frame early in it then drove the frame backwards for the rest of the step: its
    place was wrong by up to 1e-9 a sequence, fifty times what it is now.
    """
    case = Case("", zhao(e=0.9), steady(0.8, 100.0), (0.0, 0.0, 0.45, 0.2), 0.0, 0.1, TIGHT)
    done = case.run(engine=engine).trajectory
    ends = done.events[done.events.kind == workspace.ACCUMULATION]
    assert len(ends) == 1
    assert ends.after[0, V1] >= 0.0
    assert max(imbalance(case, engine)) < 1e-8


def test_heyoka_with_an_offset_finds_the_end_of_a_slip_from_rest():
    """Not ours, but kept: heyoka overlooks the second root of what is zero where a step begins.

    The judge adds 1e-22 to such event functions; without it, slips from rest did not end.
    """
    from validation.campaign.checks import verdict
    from validation.judges import heyoka_full

    device = zhao(mu_s=0.001, mu_d=0.0008)
    case = Case("", device, steady(0.2), (0.0, 0.0, 0.3, 0.0), 0.0, 1.0, TIGHT)
    rows = verdict(case, 20.0, np.array([])).rows
    assert heyoka_full.SLIP_END in {row.kind for row in rows}
    assert rows[0].t < INF


def test_an_elastic_block_pressed_to_the_stopper_is_reported_with_its_reason():
    """With e = 1 and little loss elsewhere a pressed block hops on: the error says so."""
    device = ZHAO.replace(e=1.0, m1=1e9, c=0.0)
    drive = mi.Sine(amplitude=0.0, omega=1e-2, bias=2.0)
    options = mi.Options(max_events=300)
    with pytest.raises(mi.RunError, match="restitution 1"):
        mi.simulate(device, drive, 1, initial=mi.State(x2=0.4999), options=options)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "share"),
    [
        *(("compiled", share) for share in (0.0, 0.5, 1.0)),
        ("interpreted", 0.5),
    ],
)
@pytest.mark.parametrize("v2", [1e-300, 1e-30, 1e-16])
def test_slips_and_impacts_below_rounding_end(share, v2, engine):
    """Starts on a guard: the block moves into the stopper at 1e-300 and is pulled off it.

    The kick makes the frame slip at 1e-301, for a time far below what roots are told apart to.
    Friction acted for that longer time, which threw the block back to the stopper: 5,000 impacts
    and ends of slips, and no end but that of the budget. An event that comes sooner than times are
    told apart is now taken at the state with which its arc began.
    """
    hold = hold_voltage(zhao())
    case = Case("", zhao(), steady(share * hold), (0.0, 0.0, 0.5, v2), 0.0, 0.1, TIGHT)
    events = case.run(engine=engine).trajectory.events
    assert np.count_nonzero(events.kind == workspace.TRANSITION) < 30


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_flights_that_drown_in_rounding_are_the_end_of_a_sequence(engine):
    """A start one rounding away from the stopper, pressed to it, with a frame that hardly sticks.

    The flights, lower than x2 is told apart to, did not shrink but went in a circle.
    """
    device = zhao(mu_s=0.4 / (6.0 * 9.81), mu_d=0.2 / (6.0 * 9.81))
    start = (0.0, 0.0, math.nextafter(0.5, 0.0), 0.0)
    case = Case("", device, steady(1.5 * hold_voltage(device)), start, 0.0, 0.1, TIGHT)
    final = case.run(engine=engine).trajectory.final
    assert final.mode == mode_of(STUCK, RIGHT)
    assert final.y[1:] == pytest.approx([0.0, 0.5, 0.0], rel=0, abs=1e-15)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("excess", [1e-8, 1e-10, 1e-11])
def test_a_slip_below_the_tolerance_is_at_most_one_slip(excess, engine):
    """The load exceeds the static limit at the start by a part in 1e10, and mu_d = mu_s.

    The frame creeps for 5e-9 at 1e-22. The straight line that is CVODE's first step put the end of
    the slip at its beginning; the frame slipped again, and so 10,000 times, until the budget of
    events was spent. A margin that seems to fall while its exact rate says that it rises is left
    alone until a step ends where it falls.
    """
    mu = 0.04 * (1.0 - excess) / (6.0 * 9.81)
    device = zhao(mu_s=mu, mu_d=mu)
    wave = Spec("sine", {"amplitude": 0.2, "omega": 0.05})
    case = Case("", device, wave, (0.0, 0.0, 0.0, 0.0), 0.0, 0.01, {"rtol": 1e-9, "atol": 1e-11})
    events = case.run(engine=engine).trajectory.events
    assert np.count_nonzero(events.kind == workspace.TRANSITION) <= 1


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("before", [0.0, 1e-15, 1e-13])
def test_a_load_a_rounding_below_the_static_limit(before, engine):
    """mu_d = mu_s, and the load reaches the limit within the rounding of the time.

    Events so soon after the start of an arc were once handled at the state with which it began.
    There the load was still below the limit: break-away, end of slip, break-away, for ever.
    """
    t, x2, v2 = 30.0, 0.1, 0.3
    device = zhao()
    pull = device["alpha"] * (0.05 * math.cos(0.1 * t)) ** 2 / (device["d"] - x2) ** 2
    load = device["k"] * x2 + device["c"] * v2 - pull
    mu = load * (1.0 + before) / ((device["m1"] + device["m2"]) * device["g"])
    wave = Spec("sine", {"amplitude": 0.05, "omega": 0.1})
    case = Case("", zhao(mu_s=mu, mu_d=mu), wave, (0.0, 0.0, x2, v2), t, 0.2, TIGHT)
    assert len(case.run(engine=engine).trajectory.events) < 20


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_a_voltage_that_swings_through_zero_between_two_switches_lets_the_frame_go(method, engine):
    """Random run 5:659 by dop853: the swing was one step, and load and limit the same at its ends.

    The load changes its sign, exceeds the limit while there is no voltage, and comes back. Margin
    and rate tell of nothing but a hump, as the load itself passes through zero first.
    """
    x2, high = 0.3, 0.7 * math.sqrt(0.5)  # the load is 0.3 - 0.5 with voltage, and 0.3 without
    drive = mi.Square(amplitude=high, low=-high, duty=0.6, rise=1e-3, omega=0.5)
    mu = 0.25 / (6.0 * 9.81)
    run = mi.simulate(
        ZHAO.replace(mu_s=mu, mu_d=mu),
        drive,
        3e-3 / drive.period,
        initial=mi.State(x2=x2, time=0.6 * drive.period - 1e-3),
        options=mi.Options(method=method, engine=engine),
    )
    events = run.trajectory.events
    moved = events[events.kind == workspace.TRANSITION]
    assert [GUARDS[guard].name for guard in moved.guard] == ["break-away", "slip end"]
