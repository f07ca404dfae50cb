"""What time is: that since the start of the run, for a system without a period in all functions.

Right values are closed forms: areas of pulses and ramps, times of events.
"""

import math
from functools import partial

import numpy as np
import pytest

import mems_impact as mi

OFF, ON = mi.modes("off", "on")
INTERPRETED = mi.Options(engine="interpreted", method="dop853")
METHODS = [
    mi.Options(engine="compiled", method="dop853"),
    *(
        pytest.param(options, marks=pytest.mark.slow)
        for options in (
            INTERPRETED,
            mi.Options(engine="compiled", method="adams"),
            mi.Options(engine="compiled", method="bdf"),
            mi.Options(engine="compiled", method="auto"),
        )
    ),
]
TURN = 2.0 * math.pi


def pulse(mode, t, y, p):
    return (p.height if p.begin <= t < p.begin + p.width else 0.0,)


def pulse_edges(p):
    return p.begin, p.begin + p.width


def pulsed(**given):
    values = {"begin": 20.0, "width": 10.0, "height": 1.0}
    return mi.System(states=("q",), flow=pulse, parameters=values, switches=pulse_edges, **given)


@pytest.mark.parametrize("options", METHODS)
@pytest.mark.parametrize(
    ("begin", "scale"), [(20.0, 1.0), (20.1, 0.3), (1e3 + 0.7, 7.3), (1e6 / 3.0, 1e4)]
)
def test_a_late_pulse(options, begin, scale):
    system = pulsed(time_scale=scale).changed(begin=begin)
    run = mi.simulate(system, duration=begin + 30.0, options=options)
    assert run.final.q == pytest.approx(10.0, abs=1e-9)


def test_a_late_pulse_in_scaled_variables():
    system = pulsed(typical={"q": 2e-4, "time": 0.37})
    run = mi.simulate(system, duration=33.0, options=INTERPRETED)
    assert run.final.q == pytest.approx(10.0, abs=1e-9)


def grown(mode, t, y, p):
    return (1.0 if mode == ON else 0.0,)


def wait(mode, t, y, p):
    return p.at - t


def turn_on(mode, t, y, p):
    return ON, (y.q + 1e-3 * t,)


@pytest.mark.slow
@pytest.mark.parametrize("options", METHODS)
@pytest.mark.parametrize("at", [30.0, 333.3])
def test_a_guard_at_a_time(options, at):
    guards = [mi.Guard("on", wait, turn_on, modes=(OFF,)), mi.Guard("seen", wait)]
    system = mi.System(
        states=("q",), flow=grown, modes=(OFF, ON), guards=guards, parameters={"at": at}
    )
    run = mi.simulate(system, duration=at + 70.0, options=options)
    assert run.final.q == pytest.approx(70.0 + 1e-3 * at, rel=1e-12)
    assert run.events["t"].tolist() == pytest.approx([at, at], rel=1e-15)


def ramp(mode, t, y, p):
    return (p.r * t,)


@pytest.mark.parametrize("options", METHODS)
def test_a_ramp_until_a_time(options):
    system = mi.System(states=("q",), flow=ramp, parameters={"r": 0.5})
    run = mi.simulate(system, until=lambda mode, t, y, p: 50.0 - t, options=options)
    assert (run.ended, run.end) == ("until", pytest.approx(50.0, rel=1e-15))
    assert run.final.q == pytest.approx(625.0, rel=1e-9)
    assert run.samples(per_period=1)["q"].iloc[20] == pytest.approx(100.0, rel=1e-9)


TIMES, VALUES = np.array([0.0, 10.0, 40.0, 90.0]), np.array([0.0, 3.0, -1.0, 2.0])


def recorded(mode, t, y, p):
    return (float(np.interp(t, TIMES, VALUES)),)


def test_a_record_over_the_time_of_the_run():
    system = mi.System(states=("q",), flow=recorded, switches=(10.0, 40.0))
    run = mi.simulate(system, duration=90.0, options=INTERPRETED)
    assert run.final.q == pytest.approx(np.trapezoid(VALUES, TIMES), rel=1e-9)


def test_a_jump_of_the_state_at_given_times():
    system = mi.System(
        states=("q",),
        flow=lambda mode, t, y, p: (0.0,),
        switches=(5.0, 25.0, 25.5),
        switch_transition=lambda mode, t, y, p: (mode, (y.q + t,)),
    )
    run = mi.simulate(system, duration=100.0, options=INTERPRETED)
    assert run.final.q == 55.5
    before = mi.simulate(system, duration=25.0, options=INTERPRETED)
    assert before.final.q == 5.0  # the state before the jump
    after = mi.simulate(
        system, duration=1.0, initial=before.final, start=before.end, options=INTERPRETED
    )
    assert after.final.q == 55.5


def test_observables_and_samples_have_the_time_of_the_run():
    def when(mode, t, before, after, p):
        return t

    ticks = mi.Guard("tick", lambda mode, t, y, p: 20.5 - y.q)
    for period in (None, 1.0):
        system = mi.System(
            states=("q",),
            flow=lambda mode, t, y, p: (1.0,),
            guards=[ticks],
            observables=[mi.Observable("when", when, at=("tick",), reduce="mean")],
            period=period,
        )
        run = mi.simulate(system, duration=30.0, options=INTERPRETED)
        assert run.events["when"].tolist() == pytest.approx([20.5])
        assert run.samples(per_period=2)["t"].iloc[-1] == 30.0


# --- Continued runs


def test_a_run_continues_at_its_time():
    system = mi.System(states=("q",), flow=ramp, parameters={"r": 1.0})
    first = mi.simulate(system, duration=10.0, options=INTERPRETED)
    again = mi.simulate(system, initial=first.final, duration=10.0, options=INTERPRETED)
    assert (again.final.q, again.end) == (pytest.approx(100.0, rel=1e-9), 10.0)
    later = mi.simulate(
        system, initial=first.final, start=first.end, duration=10.0, options=INTERPRETED
    )
    assert (later.final.q, later.end) == (pytest.approx(200.0, rel=1e-9), 20.0)
    assert later.samples(per_period=1)["t"].tolist() == list(range(10, 21))


def forced(mode, t, y, p):
    return (math.cos(TURN * t),)


def test_a_forced_run_continues_at_its_phase_and_time():
    kicks = {"switches": (0.5,), "switch_transition": lambda mode, t, y, p: (mode, (y.q + t,))}
    system = mi.System(states=("q",), flow=forced, period=1.0, **kicks)
    whole = mi.simulate(system, 20.3, options=INTERPRETED)
    assert whole.final.q == pytest.approx(200.0 + math.sin(0.3 * TURN) / TURN, rel=1e-9)
    first = mi.simulate(system, 10.7, options=INTERPRETED)
    later = mi.simulate(system, 9.6, initial=first.final, start=first.end, options=INTERPRETED)
    assert later.final.q == pytest.approx(whole.final.q, rel=1e-12)
    with pytest.raises(
        mi.InvalidParameter, match="start = 3: must be the phase of the initial state"
    ):
        mi.simulate(system, 1.0, initial=first.final, start=3.0)


# --- Functions of time in a system with a period


def test_until_and_records_have_the_time_of_the_run():
    seen = mi.Guard("seen", lambda mode, t, y, p: 20.3 - t)
    system = mi.System(states=("q",), flow=forced, period=1.0, guards=[seen])
    run = mi.simulate(system, until=lambda mode, t, y, p: 50.4 - t, options=INTERPRETED)
    assert run.end == pytest.approx(50.4, rel=1e-15)
    assert run.events["t"].tolist() == pytest.approx([20.3, 50.4], rel=1e-15)


def test_until_of_an_actuator_has_the_time_of_the_run():
    zhao, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
    run = mi.simulate(zhao, drive, until=lambda mode, t, y, p: 30.0 - t, options=INTERPRETED)
    assert run.end == pytest.approx(30.0, rel=1e-14)


def oscillator(rebound, **given):
    return mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -y.x + math.cos(t)),
        period=TURN,
        guards=[mi.Impact("wall", lambda mode, t, y, p: y.x + 0.5, rebound)],
        initial={"x": 0.0, "v": 1.0},
        **given,
    )


def test_a_rebound_that_changes_with_time_has_no_orbit():
    def rebound(mode, t, y, p):
        return mode, (-0.5, -(0.9 if t < 50.0 else 0.5) * y.v)

    run = mi.simulate(oscillator(rebound), 30, options=INTERPRETED)
    hits = run.impacts
    ratios = -hits["v after"] / hits["v before"]
    assert ratios.to_numpy() == pytest.approx(np.where(hits["t"] < 50.0, 0.9, 0.5), rel=1e-9)
    with pytest.raises(
        mi.FunctionError, match=r"transition of 'wall'.* is not periodic: .* at t ="
    ):
        mi.find_orbit(oscillator(rebound))


def test_a_rebound_from_a_moving_wall_has_orbits():
    def rebound(mode, t, y, p):
        return mode, (-0.5, -0.8 * y.v + 0.01 * math.cos(t))

    oscillator(rebound).checks.recurrence()


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("begin", "end", "periods"), [(20.0, 30.0, 100), (3.0, 3.9, 60), (2e3, 2e3 + 2.0, 2010)]
)
def test_a_pulse_in_a_forced_flow_is_found(begin, end, periods):
    def flow(mode, t, y, p):
        return (math.cos(TURN * t) + (1.0 if p.begin <= t < p.end else 0.0),)

    system = mi.System(
        states=("q",), flow=flow, period=1.0, parameters={"begin": begin, "end": end}
    )
    options = INTERPRETED if periods < 1e3 else mi.Options()
    for verb in (partial(mi.simulate, system, periods, options=options),
                 partial(mi.find_orbit, system)):  # fmt: skip
        with pytest.raises(mi.FunctionError, match="is not periodic") as caught:
            verb()
        later = float(str(caught.value).rpartition("at t = ")[2].partition(",")[0])
        assert begin <= later < end
        if verb.func is mi.simulate:  # the run is complete
            assert caught.value.partial.statistics["window last"] == periods


@pytest.mark.quick(1)
@pytest.mark.parametrize("period", [TURN, 6.2831853, 1e-3])
def test_a_forcing_with_jumps_and_a_rounded_period_is_periodic(period):
    def flow(mode, t, y, p):
        return (1.0 if t % p.period < 0.3 * p.period else math.cos(TURN * t / p.period),)

    system = mi.System(
        states=("q",),
        flow=flow,
        parameters={"period": period},
        period=lambda p: p.period * (1.0 + 1e-8),
        switches=lambda p: (0.3 * p.period, p.period),
        time_scale=period,
    )
    mi.simulate(system, 50, options=INTERPRETED)
    system.checks.recurrence()


# --- Refusals

NO_PERIOD = "depends on time, and the system has no period"
ORBITS = {
    "orbit": lambda system: mi.find_orbit(system),
    "equilibria": lambda system: mi.find_equilibria(system),
    "exponents": lambda system: mi.lyapunov(system),
    "sweep": lambda system: mi.sweep(system, "r", [1.0, 2.0], transient=1.0, duration=1.0),
    "map": lambda system: mi.operating_map(system, x=("r", [1.0, 2.0]), y=("s", [1.0, 2.0])),
    "basins": lambda system: mi.basins(system, x=("x", [0.0, 1.0]), y=("v", [0.0, 1.0])),
}


def swinging(**given):
    values = {"flow": lambda mode, t, y, p: (y.v, -p.r * y.x), "parameters": {"r": 1.0, "s": 1.0}}
    return mi.System(states=("x", "v"), **{**values, **given})


@pytest.mark.parametrize("verb", ORBITS)
def test_a_flow_that_depends_on_time_has_no_periodic_motion(verb):
    late = swinging(flow=lambda mode, t, y, p: (y.v, -p.r * y.x + (1.0 if t > 1e3 else 0.0)))
    with pytest.raises(mi.FunctionError, match=NO_PERIOD):
        ORBITS[verb](late)


@pytest.mark.parametrize(
    "given",
    [
        {"guards": [mi.Guard("late", lambda mode, t, y, p: 1e3 - t)]},
        {"guards": [mi.Guard("low", lambda mode, t, y, p: y.x, lambda mode, t, y, p: (0, (t, 0)))]},
        {"switches": (3.0,)},
    ],
)
def test_whatever_depends_on_time_rules_out_orbits(given):
    system = swinging(initial={"x": 1.0}, **given)
    with pytest.raises(mi.MemsImpactError, match=NO_PERIOD):
        mi.find_orbit(system)


@pytest.mark.parametrize("period", [pytest.param(None, marks=pytest.mark.slow), 1.0])
def test_a_run_whose_end_does_not_come_says_so(period):
    scale = 1e3 if period is None else None
    system = mi.System(
        states=("q",), flow=lambda mode, t, y, p: (1.0,), period=period, time_scale=scale
    )
    with pytest.warns(mi.LengthWarning, match="default length"):
        run = mi.simulate(system, until=lambda mode, t, y, p: 1.0 + y.q)
    assert run.ended == "time"
