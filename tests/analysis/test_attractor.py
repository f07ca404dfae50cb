"""What motions come to: the kind of attractor, and what is gathered of it, against runs."""

import math
from dataclasses import replace
from decimal import Decimal, localcontext

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.attractor import InitialCondition, RecurrenceOptions, map_attractors
from mems_impact.hybrid import engine as engine_module
from mems_impact.hybrid.attractors import mapper
from mems_impact.hybrid.engine import StepQuota, create_engine
from mems_impact.hybrid.variational import lyapunov
from tests.analysis import oscillators
from tests.analysis.systems import ball

ACTUATOR = mi.load_actuator("zhao2004")
FAST = mi.Options(method="dop853")
SHORT = RecurrenceOptions(transient=200, periods=40)


def device(amplitude, omega=0.5):
    return ACTUATOR.under(mi.Sine(amplitude=amplitude, omega=omega))


def cases(*amplitudes):
    return [InitialCondition(device(amplitude), mi.State(v2=1.0)) for amplitude in amplitudes]


def test_kinds_of_motion_of_the_paper():
    off, one, wild = map_attractors(cases(0.15, 0.24, 0.262), SHORT, FAST)
    assert (off.motion, off.period) == ("off", 1)
    assert (one.motion, one.period) == ("periodic", 1)
    assert off.measures["impacts per period"] == 0.0
    assert one.measures["impacts per period"] == pytest.approx(1.0, abs=1e-12)
    assert off.returns < 200
    assert wild.status == "ok"


def test_measures_are_the_statistics_of_a_settled_run():
    (found,) = map_attractors(cases(0.24), replace(SHORT, tolerance=1e-9), FAST)
    run = mi.simulate(
        device(0.24), 300, initial=mi.State(v2=1.0), window=(250, 290), options=FAST
    ).statistics
    shared = [name for name in found.measures if name in run.index]
    assert len(shared) > 8
    for name in shared:
        assert found.measures[name] == pytest.approx(run[name], rel=1e-7, nan_ok=True), name


def test_a_motion_that_wanders_is_measured_after_the_transient():
    # In the chaotic band; statistics over the same periods as an ordinary run gathers.
    amplitude, omega = 0.24, 0.45
    recurrence = RecurrenceOptions(transient=20, periods=15, longest=2, tolerance=1e-12)
    recurrence = replace(recurrence, exponents="none")
    (found,) = map_attractors(
        [InitialCondition(device(amplitude, omega), mi.State(v2=1.0))], recurrence, FAST
    )
    assert found.motion == "unsettled"
    run = mi.simulate(
        device(amplitude, omega), 35, initial=mi.State(v2=1.0), window=(20, 35), options=FAST
    ).statistics
    assert found.final.time < 2.0 * math.pi / omega
    for name in ("impacts per period", "displacement per period", "energy lost per period"):
        assert found.measures[name] == pytest.approx(run[name], rel=1e-6), name


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "adams"])
def test_a_point_is_the_same_in_any_group(method):
    options = mi.Options(method=method)
    recurrence = RecurrenceOptions(transient=60, periods=10, exponents="all")
    many = cases(0.15, 0.2, 0.24, 0.28)
    together = map_attractors(many, recurrence, options)
    for case, one in zip(many, together, strict=True):
        (alone,) = map_attractors([case], recurrence, options)
        assert alone.measures == pytest.approx(one.measures, rel=0.0, abs=0.0, nan_ok=True)
        assert np.array_equal(alone.states, one.states)
        assert (alone.motion, alone.period, alone.returns) == (one.motion, one.period, one.returns)
        assert (alone.exponent, alone.error) == (one.exponent, one.error)


def van_der_pol(mode, t, y, p):
    return y.v, (1.0 - y.x * y.x) * p.k * y.v - p.k * p.k * y.x


def test_lengths_are_in_the_time_scale_of_each_point():
    system = mi.System(
        flow=van_der_pol,
        states=("x", "v"),
        parameters={"k": 1.0},
        section=("x", 0.0),
        initial=mi.State(x=2.0),
        time_scale=lambda p: 1.0 / p.k,
    )
    recurrence = RecurrenceOptions(transient=0.0, periods=30.0, longest=1, tolerance=1e-13)
    recurrence = replace(recurrence, exponents="none")
    many = [InitialCondition(system.changed(k=k)) for k in (1.0, 4.0, 0.25)]
    together = map_attractors(many, recurrence)
    assert len({each.returns for each in together}) == 1
    for case, one in zip(many, together, strict=True):
        (alone,) = map_attractors([case], recurrence)
        assert alone.returns == one.returns
        assert alone.measures == pytest.approx(one.measures, rel=0.0, abs=0.0, nan_ok=True)


def spiral(mode, t, y, p):
    return y.v, -y.x - 0.1 * y.v


DECAYING = mi.System(flow=spiral, states=("x", "v"), initial=mi.State(x=1.0))


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("system", "recurrence"),
    [
        (device(0.24), RecurrenceOptions(transient=60, periods=10)),
        pytest.param(
            device(0.24, 0.45),
            RecurrenceOptions(transient=20, periods=5, chaos_persistence=1.0),
            marks=pytest.mark.slow,
        ),
        (oscillators.belt(), RecurrenceOptions(transient=80.0, periods=20.0, exponents="all")),
        (DECAYING, RecurrenceOptions(transient=600.0, periods=5.0)),
        (ball(), RecurrenceOptions(transient=30.0, periods=5.0)),
    ],
    ids=["periodic", "chaotic", "cycle", "spiral", "ball"],
)
def test_results_do_not_depend_on_the_steps_per_call(monkeypatch, system, recurrence):
    """Compiled code returns to its caller after 1, 7 or 20,000 steps at first."""
    found = []
    for steps in (1, 7, 20_000):

        def bound(problem, *extension, steps=steps, **more):
            return replace(create_engine(problem, *extension, **more), quota=StepQuota(steps))

        for module in (mapper, lyapunov):
            monkeypatch.setattr(module, "create_engine", bound)
        found += map_attractors([InitialCondition(system)], recurrence, FAST)
    first = found[0]
    for one in found[1:]:
        assert repr(one) == repr(first)
        assert np.array_equal(one.states, first.states)


@pytest.mark.slow
def test_interpreted_and_compiled_tell_the_same():
    recurrence = RecurrenceOptions(transient=5, periods=40, tolerance=1e-3, exponents="none")
    (fast,) = map_attractors(cases(0.24), recurrence, FAST)
    (slow,) = map_attractors(cases(0.24), recurrence, replace(FAST, engine="interpreted"))
    assert (fast.motion, fast.period, fast.returns) == (slow.motion, slow.period, slow.returns)
    assert slow.measures == pytest.approx(fast.measures, rel=1e-8, nan_ok=True)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["compiled", "interpreted"])
def test_an_orbit_is_known_once_it_has_come_again_twice(engine):
    """Begun on it, and so simple that it is met exactly: of four returns the last two repeat both.

    Each point counts for itself.
    """

    def round_and_round(mode, t, y, p):  # from 0 to 1, and 0 again: a guard's is the only event
        return 1.0, p.omega

    def one(mode, t, y, p):
        return 1.0 - y.s

    turning = mi.System(
        states=("s", "angle"), flow=round_and_round, period=1.0, parameters={"omega": 0.5},
        guards=[mi.Guard("one", one, lambda mode, t, y, p: (mode, (y.s - 1.0, 0.0)))],
        initial={"s": 0.25},
    )  # fmt: skip
    recurrence = RecurrenceOptions(transient=10, periods=2, tolerance=1e-6, exponents="none")
    options = replace(FAST, engine=engine)
    found = map_attractors(2 * [InitialCondition(turning)], recurrence, options)
    assert [(each.motion, each.period, each.returns) for each in found] == 2 * [("periodic", 1, 4)]


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_what_moves_slowly_does_not_rest(unit):
    """Round a circle in so many units of time: measured by the time that the system tells."""
    round_and_round = mi.System(
        states=("x", "y"),
        flow=lambda mode, t, y, p: (-y.y / p.unit, y.x / p.unit),
        parameters={"unit": unit},
        time_scale=unit,
        section=("y", 0.0),
        initial={"x": 1.0, "y": -0.1},
    )
    recurrence = RecurrenceOptions(transient=40.0, periods=5.0, tolerance=1e-5, exponents="none")
    options = replace(FAST, engine="interpreted")
    (found,) = map_attractors([InitialCondition(round_and_round)], recurrence, options)
    assert (found.motion, found.period) == ("periodic", 1)
    assert found.measures["return time"] == pytest.approx(2.0 * math.pi * unit, rel=1e-6)


@pytest.mark.slow
def test_a_motion_that_is_followed_until_it_rests_is_resting():
    """In a double well, at whose bottom it rests after the transient."""
    well = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, y.x - y.x**3 - 0.3 * y.v),
        initial={"x": 0.5, "v": 0.5},
    )
    recurrence = RecurrenceOptions(transient=100, periods=20)
    found, begun = (
        map_attractors([InitialCondition(well)], each, FAST)[0]
        for each in (recurrence, replace(recurrence, exponents="none"))
    )
    assert begun.motion == "unsettled"
    assert found.motion == "resting"
    assert found.final.x == pytest.approx(1.0, abs=1e-9)


def test_few_returns_are_no_regular_approach():
    """Differences of a chaotic map decrease for a while by chance, in half of so short motions."""
    system = mi.System(
        states=("x",),
        flow=lambda mode, t, y, p: (0.0,),
        switch_transition=lambda mode, t, y, p: (mode, (3.95 * y.x * (1.0 - y.x),)),
        switches=(0.5,),
        period=1.0,
    )
    cases = [InitialCondition(system, mi.State(x=x)) for x in np.linspace(0.1, 0.9, 10)]
    recurrence = RecurrenceOptions(transient=20, periods=10, exponents="none")
    options = replace(FAST, engine="interpreted")
    found = map_attractors(cases, recurrence, options)
    assert {each.returns for each in found} == {31}


def smooth(mode, t, y, p):
    # A linear oscillator with a relaxation of rate k, which makes it stiff if k is large.
    return y.v, -p.d * y.v - y.z + p.a * math.cos(p.w * t), -p.k * (y.z - y.x)


@pytest.mark.parametrize(
    ("method", "rate"), [("adams", 30.0), ("bdf", 3e4), ("auto", 30.0), ("auto", 3e4)]
)
def test_smooth_motion_settles_within_the_errors_of_the_method(method, rate):
    # Its returns differ for ever by 50 relative tolerances, since steps do not repeat.
    values = {"d": 0.1, "a": 0.3, "w": 2.3, "k": rate}
    system = mi.System(
        states=("x", "v", "z"),
        flow=smooth,
        parameters=values,
        period=lambda p: 2.0 * math.pi / p.w,
        initial={"x": 0.0, "v": 0.0, "z": 0.0},
    )
    recurrence = RecurrenceOptions(transient=200, periods=20, longest=2, exponents="none")
    options = mi.Options(method=method)
    (found,) = map_attractors([InitialCondition(system)], recurrence, options)
    assert (found.status, found.motion, found.period) == ("ok", "periodic", 1)
    w = values["w"]
    # x'' + d x' + z = a cos(w t), z' = k (x - z)
    x = 0.3 / (-w * w + 1j * 0.1 * w + rate / (rate + 1j * w))
    assert found.final["x"] == pytest.approx(x.real, rel=1e-5)


@pytest.mark.parametrize("transient", [0, 1, 40, 300])
def test_closest_approaches_are_those_of_a_run(transient):
    actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.18, omega=0.5)
    system = ActuatorSystem(actuator, drive)
    start = mi.kicked_state(actuator)
    recurrence = RecurrenceOptions(transient=transient, periods=150, exponents="none")
    (found,) = map_attractors([InitialCondition(system, start)], recurrence)
    assert found.motion == "off"
    run = mi.simulate(actuator, drive, periods=400, initial=start)
    x2 = run.samples(per_period=2000, first=398.0)["x2"]
    assert found.measures["closest approach"] == pytest.approx(
        actuator.delta - np.abs(x2).max(), rel=1e-5
    )


@pytest.mark.slow
def test_chaos_is_classified_by_the_exponent():
    # The exponent by two neighbouring runs: 0.51 per period (`tests/analysis/test_lyapunov.py`).
    wild, near_off = map_attractors(
        [
            InitialCondition(device(0.24, 0.45), mi.State(v2=1.0)),
            InitialCondition(device(0.2), mi.State(v2=1.0)),
        ],
        RecurrenceOptions(transient=60, periods=20),
        FAST,
    )
    assert wild.motion == "chaotic"
    assert near_off.motion == "off"
    period = math.pi / 0.45
    assert abs(wild.exponent * period - 0.51) < 5.0 * wild.error * period + 0.05


def test_a_limit_cycle_is_classified_by_its_returns():
    cycle = oscillators.belt()
    recurrence = RecurrenceOptions(transient=80.0, periods=20.0, tolerance=1e-8)
    (found,) = map_attractors([InitialCondition(cycle)], recurrence, FAST)
    assert (found.motion, found.period) == ("periodic", 1)
    period = oscillators.belt_period(0.3, 0.4)
    assert found.measures["return time"] == pytest.approx(period, rel=1e-8)
    assert found.measures["share stick"] == pytest.approx(2.0 * 0.4 / 0.3 / period, rel=1e-7)


def test_rest_of_a_system_without_forcing():
    recurrence = RecurrenceOptions(transient=30.0, periods=5.0)
    (found,) = map_attractors([InitialCondition(ball())], recurrence, FAST)
    assert found.motion == "resting"
    assert found.status == "ok"


def test_a_failing_point_says_why():
    bad, good = device(0.24), device(0.24)
    cases = [InitialCondition(bad, mi.State(x2=5.0)), InitialCondition(good, mi.State(v2=1.0))]
    failed, fine = map_attractors(cases, SHORT, FAST)
    assert failed.motion == "failed"
    assert "x2" in failed.status
    assert fine.motion == "periodic"
    few = mi.Options(method="dop853", max_steps=3)
    (failed,) = map_attractors([InitialCondition(good, mi.State(v2=1.0))], SHORT, few)
    assert "max_steps = 3" in failed.status


def mapped(switch_transition, value, x=0.4):
    """A map, once a period; nothing moves in between."""
    return mi.System(
        states=("x",), flow=lambda mode, t, y, p: (0.0,), switches=(0.5,),
        switch_transition=switch_transition, period=1.0, parameters={"a": value}, initial={"x": x},
    )  # fmt: skip


def _logistic(mode, t, y, p):
    return mode, (p.a * y.x * (1.0 - y.x),)


def _circle(mode, t, y, p):
    return mode, ((y.x + p.a - 0.5 / math.tau * math.sin(math.tau * y.x)) % 1.0,)


def _found(system, **recurrence):
    options = replace(FAST, engine="interpreted")
    recurrence = RecurrenceOptions(
        **{"transient": 60, "periods": 20, "exponents": "none", **recurrence}
    )
    return map_attractors([InitialCondition(system)], recurrence, options)[0]


@pytest.mark.slow
@pytest.mark.parametrize(("a", "motion", "period"), [(2.97, "resting", 1), (3.012, "periodic", 2)])
def test_what_comes_nearer_and_nearer_is_followed_until_it_arrives(a, motion, period):
    """Multipliers of -0.97 and 0.95: 80 periods are not enough, as their rate tells."""
    found = _found(mapped(_logistic, a), tolerance=1e-4)
    assert (found.motion, found.period) == (motion, period)
    assert 80 < found.returns < 500
    apart = math.sqrt((a - 3.0) * (a + 1.0)) / (2.0 * a) if period == 2 else 0.0
    middle = (a + 1.0) / (2.0 * a) if period == 2 else 1.0 - 1.0 / a
    expected = {1: [middle], 2: [middle - apart, middle + apart]}[period]
    assert sorted(found.states[:, 0]) == pytest.approx(expected, abs=1e-4)


@pytest.mark.nightly
def test_small_differences_that_accumulate_are_no_errors_of_the_method():
    """A slow approach with the multiplier 0.99; and one of -1.02, along which motions leave."""
    slow = _found(mapped(_logistic, 1.01, x=0.0099), transient=3000, longest=1)
    assert slow.motion == "resting"
    assert slow.final["x"] == pytest.approx(1.0 - 1.0 / 1.01, rel=2e-6)
    middle = 1.0 - 1.0 / 3.02
    left = _found(mapped(_logistic, 3.02, x=middle * (1.0 + 2e-7)), transient=3000)
    assert (left.motion, left.period) == ("periodic", 2)


def test_what_does_not_come_nearer_is_no_orbit():
    """On a circle; and beside the ghost of a fold, where returns differ least in the middle."""
    assert _found(mapped(_circle, 0.3), tolerance=1e-4).motion == "unsettled"
    ghost = mapped(_circle, 0.5 / math.tau + 1e-5, x=0.25)
    assert _found(ghost, tolerance=1e-5).motion == "unsettled"


def test_a_map_between_whose_iterations_nothing_moves_does_not_rest():
    found = _found(mapped(_logistic, 3.2))
    assert (found.motion, found.period) == ("periodic", 2)
    assert _found(mapped(_logistic, 3.9)).motion == "unsettled"


def test_what_passes_an_unstable_orbit_by_chance_is_no_orbit():
    """Chaos comes near every orbit now and then, here near the unstable one of period 1."""
    wild = mapped(_logistic, 3.6807680393195996)
    recurrence = RecurrenceOptions(transient=25_500, periods=100, exponents="none")
    (found,) = map_attractors([InitialCondition(wild)], recurrence, FAST)
    assert (found.motion, found.period) == ("unsettled", 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("a", "motion", "period"), [(3.673, "periodic", 10), (3.656, "periodic", 18)]
)
def test_a_transient_among_chaos_is_not_chaotic(a, motion, period):
    """Of the logistic map: to an orbit of period 10, and to one of 18, more than `longest`."""
    with localcontext(prec=60):
        r, states = Decimal(a), [Decimal("0.4")]
        for _ in range(30_000):
            states.append(r * states[-1] * (1 - states[-1]))
        apart = [abs(states[-1] - states[-1 - n]) for n in range(1, 19)]
    exact = next(n for n, each in enumerate(apart, start=1) if each < 1e-20)
    assert exact == period
    (found,) = map_attractors([InitialCondition(mapped(_logistic, a))], RecurrenceOptions(), FAST)
    assert (found.motion, found.period) == (motion, period)


def _henon(mode, t, y, p):
    return mode, (1.0 - p.a * y.x * y.x + y.y, 0.3 * y.x)


def _periods_of_iteration(step, start, most=64, transient=200_000):
    """Return after how many iterations a map repeats itself, iterated as it stands; 0: never."""
    state = start
    for _ in range(transient):
        state = step(*state)
    states = [state]
    for _ in range(2 * most):
        states.append(step(*states[-1]))
    for n in range(1, most + 1):
        off = (abs(a - b) for k in range(n) for a, b in zip(states[k], states[k + n], strict=True))
        if max(off) < 1e-8:
            return n
    return 0


@pytest.mark.nightly
@pytest.mark.parametrize("a", [3.8477363, 3.8494863, 3.7234863, 3.9222363])
def test_an_exponent_without_a_sign_is_computed_for_longer(a):
    """Motions that have no sign of an exponent after 400 returns: of period 12, and chaotic."""
    exact = _periods_of_iteration(lambda x: (a * x * (1.0 - x),), (0.4,))
    (found,) = map_attractors([InitialCondition(mapped(_logistic, a))], RecurrenceOptions(), FAST)
    assert found.period == exact
    assert found.motion == ("periodic" if exact else "chaotic")


@pytest.mark.nightly
@pytest.mark.parametrize("a", [1.026011, 1.260011, 1.096011])
def test_windows_of_henons_map_are_found_and_no_map_is_quasi_periodic(a):
    """Of periods 8 and 14; and a weak attractor whose exponent is zero to within its error."""
    system = mi.System(
        states=("x", "y"), flow=lambda mode, t, y, p: (0.0, 0.0), switches=(0.5,),
        switch_transition=_henon, period=1.0, parameters={"a": a}, initial={"x": 0.1, "y": 0.1},
    )  # fmt: skip
    exact = _periods_of_iteration(lambda x, y: (1.0 - a * x * x + y, 0.3 * x), (0.1, 0.1))
    (found,) = map_attractors([InitialCondition(system)], RecurrenceOptions(), FAST)
    if exact:
        assert (found.motion, found.period) == ("periodic", exact)
    else:
        assert found.motion in ("chaotic", "unsettled")


@pytest.mark.slow
def test_a_turn_by_an_irrational_angle_is_quasi_periodic():
    """Perturbations swing as the circle map does, and never shrink."""
    system = mapped(_circle, (math.sqrt(5.0) - 1.0) / 2.0)
    options = RecurrenceOptions(tolerance=1e-8, longest=4)
    (found,) = map_attractors([InitialCondition(system)], options, FAST)
    assert found.motion == "quasi-periodic"


def test_chatter_counts_alike_in_runs_and_studies():
    # Each period ends a chatter sequence, which is no impact, but loses energy.
    system = ACTUATOR.replace(mu_s=0.01, mu_d=0.01).under(mi.Sine(amplitude=0.45, omega=0.1))
    recurrence = RecurrenceOptions(transient=40, periods=20, tolerance=1e-9, exponents="none")
    start = mi.State(v2=1.0)
    (found,) = map_attractors([InitialCondition(system, start)], recurrence, FAST)
    run = mi.simulate(system, 60, initial=start, window=(48, 60), options=FAST).statistics
    assert found.period == 1
    assert found.measures["chatter per period"] == pytest.approx(run["chatter sequences"] / 12)
    shared = {name for name in found.measures if name in run.index}
    assert {"impact speed min", "impact speed mean", "energy lost per period"} < shared
    for name in shared:
        # The run and the attractor agree within the tolerance of the recurrence.
        assert found.measures[name] == pytest.approx(run[name], rel=1e-8, nan_ok=True), name


def relay_flow(mode, t, y, p):
    return y.v, p.mu * (1.0 - y.x * y.x) * y.v - p.k * y.x


def relay_margin(mode, t, y, p):
    return y.x * (1 - 2 * mode)


def relay_transition(mode, t, y, p):
    return 1 - mode, (y.x, y.v)


def kinetic_energy(mode, t, before, after, p):
    return before.v * before.v


@pytest.mark.slow
def test_rates_of_an_autonomous_system_are_per_unit_of_its_time():
    kinetic = mi.Observable("energy", kinetic_energy, at=("zero",), reduce="sum")
    system = mi.System(
        flow=relay_flow,
        states=("x", "v"),
        modes=("right", "left"),
        parameters={"mu": 1e3, "k": 1e6},
        guards=[mi.Guard("zero", relay_margin, relay_transition)],
        initial=mi.State(x=1.0, v=1.0, mode="right"),
        observables=[kinetic],
        typical={"time": 1e-3, "v": 1e3, "mu": 1e3, "k": 1e6},
    )
    recurrence = RecurrenceOptions(transient=0.05, periods=0.02, exponents="none")
    (found,) = map_attractors([InitialCondition(system, None)], recurrence)
    assert found.motion == "periodic"
    length = 6 * found.measures["return time"]
    run = mi.simulate(system, duration=0.05, window=(0.05 - length, 0.05)).statistics
    assert run["window last"] == pytest.approx(0.05, rel=1e-15)
    for name in ("impacts per time", "zero per time", "energy"):
        assert found.measures[name] == pytest.approx(run[name], rel=1e-6), name


@pytest.mark.parametrize("engine", ["interpreted", "compiled"])
def test_motion_without_returns_is_unsettled(engine):
    recurrence = RecurrenceOptions(transient=20.0, periods=10.0, exponents="none")
    options = mi.Options(engine=engine, method="dop853")
    (found,) = map_attractors([InitialCondition(DECAYING)], recurrence, options)
    assert found.motion == "unsettled"


def test_run_error_of_an_autonomous_system_has_the_time():
    with pytest.raises(mi.RunError, match=r"\(time 0\.\d+, mode ") as caught:
        mi.simulate(DECAYING, duration=50, options=mi.Options(max_steps=20, engine="interpreted"))
    assert caught.value.phase_time + caught.value.cycle * caught.value.period < 50.0


@pytest.mark.slow
def test_an_exponent_can_be_interrupted(monkeypatch):
    monkeypatch.setattr(engine_module, "CALL_SECONDS", 1e-3)
    case, calls = [InitialCondition(device(0.24, 0.45))], {}
    for exponents in ("none", "unsettled"):
        done = calls[exponents] = []
        recurrence = RecurrenceOptions(
            transient=20, periods=5, chaos_persistence=1.0, exponents=exponents
        )
        map_attractors(case, recurrence, FAST, watch=done.append)
    assert len(calls["unsettled"]) > len(calls["none"]) + 5
