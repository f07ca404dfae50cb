"""Closing of a contact, against an independent integrator and the energy in closed form."""

import math
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mems_impact as mi

SWITCH = mi.load_actuator("abdulrahim2016")
STEP = mi.VoltageStep(amplitude=90.0)
INTERPRETED = mi.Options(method="dop853", engine="interpreted", rtol=1e-10, atol=1e-12)


@pytest.fixture(scope="module")
def found():
    return mi.closing(SWITCH, STEP)


def flight(device, volts, t, y, side=1.0):
    """Return the events of a flight in a fixed frame: turning points and the next contact."""

    def rates(t, y):
        x, v = y
        pull = device.alpha * volts**2 / (device.d - x) ** 2
        return v, (pull - device.k * x - device.c * v) / device.m2

    def contact(t, y):
        return y[0] - device.delta

    def turn(t, y):
        return y[1]

    contact.terminal, contact.direction, turn.direction = True, 1.0, 1.0
    done = solve_ivp(rates, (t, t + 1e-3), y, "DOP853", events=(contact, turn),
                     rtol=1e-11, atol=[1e-17, 1e-12])  # fmt: skip
    lowest = done.y_events[1][:, 0].min(initial=device.delta)
    return done.t_events[0][0], done.y_events[0][0], device.delta - lowest


def test_published_numbers_of_the_switch():
    """Table 1 of Abdul Rahim and Younis (2016), and the two readings of its frequency."""
    sheet = SWITCH.datasheet
    assert sheet["frequency"] == pytest.approx(21e3, rel=1e-12)
    assert sheet["damping_ratio"] == pytest.approx(0.02, rel=1e-12)
    assert (SWITCH.k, SWITCH.d, SWITCH.delta) == (42.0, 3.8e-6, 2.6e-6)
    assert SWITCH.alpha / SWITCH.m2 == pytest.approx(1.9e-11, rel=1e-8)
    volts = [math.sqrt(4.0 * omega**2 * SWITCH.d**3 / (27.0 * 1.9e-11))
             for omega in (2.0 * math.pi * 21e3, 21e3)]  # fmt: skip
    assert mi.pull_in_voltage(SWITCH) == pytest.approx(volts[0], rel=1e-8)
    assert volts == pytest.approx([86.3, 13.7], abs=0.05)
    assert SWITCH.e == pytest.approx(math.exp(-math.pi * 0.2 / math.sqrt(1.0 - 0.04)), abs=5e-5)


def test_a_contact_spring_of_61_khz_would_collapse():
    """The largest voltage at which it is in equilibrium, below pull-in; as the preset states."""
    x = np.linspace(SWITCH.delta, SWITCH.d, 100_001)
    force = SWITCH.k * (x + ((61 / 21) ** 2 - 1.0) * (x - SWITCH.delta))
    volts = np.sqrt(force / SWITCH.alpha) * (SWITCH.d - x)
    assert volts.max() == pytest.approx(62.7, abs=0.05)
    assert volts.max() < mi.pull_in_voltage(SWITCH)


def test_energy_of_a_closing(found):
    """A constant voltage does the work alpha v^2 (1/(d - delta) - 1/d)."""
    ends = 1.0 / (SWITCH.d - SWITCH.delta) - 1.0 / SWITCH.d
    given = SWITCH.alpha * 90.0**2 * ends
    stored = 0.5 * SWITCH.k * SWITCH.delta**2
    assert found.energy.input == pytest.approx(given, rel=1e-6)
    assert found.energy.lost == pytest.approx(given - stored, rel=1e-6)


def test_values(found, tmp_path):
    assert pickle.loads(pickle.dumps(found)) == found
    found.save(tmp_path / "closing.zip")
    assert mi.load(tmp_path / "closing.zip") == found
    assert "closing_time=2.7795e-05 s" in repr(found)
    assert found.table.attrs["units"]["flight"] == "s"
    assert mi.closing(SWITCH, mi.VoltageStep(amplitude="90 V")) == found


def test_units(found):
    """The same closing without units."""
    scales = SWITCH.scales
    drive = mi.VoltageStep(amplitude=90.0 / scales.unit("V"))
    bare = mi.closing(SWITCH.to_dimensionless(), drive)
    assert bare.closing_time * scales.unit("s") == pytest.approx(found.closing_time, rel=1e-8)
    assert bare.impact_speed * scales.unit("m/s") == pytest.approx(found.impact_speed, rel=1e-8)
    assert bare.bounces == found.bounces
    assert " s," not in repr(bare)


@pytest.mark.nightly
def test_it_closes_above_the_dynamic_pull_in_voltage():
    volts = mi.pull_in_voltage(SWITCH, dynamic=True)
    below, above = (
        mi.closing(SWITCH, mi.VoltageStep(amplitude=each * volts), options=INTERPRETED)
        for each in (0.999, 1.001)
    )
    assert math.isnan(below.closing_time)
    assert (below.bounces, below.stopper, len(below.table)) == (0, "", 0)
    assert above.closing_time > 0.0


def test_stoppers_and_restitution():
    duration = 1e-4
    none = mi.VoltageStep(amplitude=0.0, duration=duration)
    pull = mi.VoltageStep(amplitude=90.0, duration=duration)
    drive = mi.Voltages(right=none, left=pull)
    left = mi.closing(SWITCH, drive, duration=duration, options=INTERPRETED)
    assert left.stopper == "left"
    assert left.closing_time == pytest.approx(2.7795033e-5, rel=1e-6)
    dead = mi.closing(SWITCH.replace(e=0.0), STEP)
    assert dead.settling_time == dead.closing_time
    assert dead.bounces == 0
    elastic = mi.closing(SWITCH.replace(e=1.0, c=0.0), STEP, duration="200 us")
    assert math.isnan(elastic.settling_time)
    # The block returns almost to its start, with the frame at rest.
    assert elastic.table["height"].iloc[0] == pytest.approx(SWITCH.delta, rel=1e-3)


def test_a_compliant_contact_is_that_of_scipy():
    """Contacts of finite duration and the flights between them, by Hunt and Crossley's force."""
    term = mi.CompliantStopper(stiffness=4e3, damping=1.0)
    device = SWITCH.adding(term)
    found = mi.closing(device, STEP, duration=6e-5, options=INTERPRETED)

    def rates(t, y):
        x, v = y
        depth = max(x - device.delta, 0.0)
        push = term.stiffness * depth * max(1.0 + 1.5 * term.damping * v, 0.0)
        pull = device.alpha * 90.0**2 / (device.d - x) ** 2
        return v, (pull - push - device.k * x - device.c * v) / device.m2

    def border(t, y):
        return y[0] - device.delta

    done = solve_ivp(rates, (0.0, 6e-5), (0.0, 0.0), "DOP853", events=border,
                     rtol=1e-10, atol=[1e-17, 1e-11], max_step=1e-7)  # fmt: skip
    times, speeds = done.t_events[0], done.y_events[0][:, 1]
    table = found.table
    assert table["t"].to_numpy() == pytest.approx(times[::2], rel=1e-5)
    assert table["impact speed"].to_numpy() == pytest.approx(speeds[::2], rel=1e-4)
    ends = times[1::2]
    assert table["contact"].iloc[:-1].to_numpy() == pytest.approx(ends - times[:-1:2], rel=1e-4)
    assert found.bounces == 3


@pytest.mark.slow
@pytest.mark.parametrize("duration", [2.8e-5, 5.4e-5])
def test_a_block_within_a_compliant_contact_may_leave_it(duration):
    """In the flights that follow, by the test above, the block is far from the stopper."""
    device = SWITCH.adding(mi.CompliantStopper(stiffness=4e3, damping=1.0))
    assert math.isnan(mi.closing(device, STEP, duration=duration).settling_time)
    settled = mi.closing(device, STEP)
    assert settled.settling_time == settled.table["t"].iloc[-1] > duration


def test_a_run_that_begins_on_the_stopper():
    held = mi.closing(SWITCH, STEP, initial=mi.State(x2=SWITCH.delta), duration=5e-5)
    assert len(held.table) == 0
    assert math.isnan(held.closing_time)


def test_a_block_that_is_pulled_off_and_rests_on_the_other_stopper():
    switch = mi.load_actuator("abdulrahim2016")
    pulled = switch.replace(g=3.0 * switch.k * switch.delta / switch.m2)
    pulled = pulled.adding(mi.Tilt(angle=1.2))  # to the left, against the spring
    pulse = mi.PulseAndHold(amplitude=400.0, width=1e-5, hold=0.0)
    found = mi.closing(pulled, pulse, options=INTERPRETED)
    assert found.stopper == "right"
    assert math.isnan(found.settling_time)
    last = found.table[found.table["stopper"] == "right"].iloc[-1]
    across = found.table[found.table["stopper"] == "left"].iloc[0]
    # The chatter sequence ends in a rest contact until the end of the pulse.
    assert last["t"] + last["contact"] == pytest.approx(pulse.width, rel=1e-6)
    assert across["t"] == pytest.approx(pulse.width + last["flight"], rel=1e-6)
    assert last["height"] == pytest.approx(2.0 * switch.delta, rel=1e-6)
    assert found.table.iloc[-1][["contact", "flight", "height"]].isna().all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"drive": 3.0}, "drive = 3: must be a Drive, such as VoltageStep"),
        ({"actuator": "switch"}, "actuator = 'switch': must be an Actuator"),
        ({"duration": -1.0}, "duration = -1: must be a finite number > 0"),
        ({"duration": "3 V"}, "must be a number"),
        ({"smallest_bounce": 0.0}, "smallest_bounce = 0: must be between 0 and 1"),
    ],
)
def test_wrong_arguments(arguments, message):
    with pytest.raises(mi.InvalidParameter, match=message):
        mi.closing(**{"actuator": SWITCH, "drive": STEP, **arguments})


# --- Drives without a forcing period


def test_functions_that_need_a_period_refuse_a_step(tmp_path):
    refusal = "duration: missing: without a duration, this voltage has no forcing period"
    for refused in (
        lambda: mi.simulate(SWITCH, STEP),
        lambda: mi.find_orbit(SWITCH, STEP),
        lambda: mi.plot_drive(STEP),
        lambda: mi.Burst(wave=STEP, on=1, off=1).period,
        lambda: SWITCH.under(STEP),
    ):
        with pytest.raises(mi.InvalidParameter, match=refusal):
            refused()
    path = tmp_path / "step.toml"
    path.write_text('[drive]\nkind = "voltage-step"\namplitude = "90 V"\n')
    assert mi.load(path) == STEP
    run = mi.simulate(SWITCH, STEP.replace(duration=5e-5), 1)
    assert run.impacts["t"].iloc[0] == pytest.approx(2.7795033e-5, rel=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: mi.VoltageStep(amplitude=1.0, rise=2.0, duration=1.0),
            "duration = 1: must be above 2",
        ),
        (lambda: mi.PulseAndHold(amplitude=1.0, width=1.0, hold=1.0, rise=2.0), "rise = 2: must"),
        (
            lambda: mi.PulseAndHold(amplitude=1.0, width=1.0, hold=1.0, pause=0.1, rise=0.5),
            "pause = 0.1: must be 0, or at least the rise = 0.5",
        ),
        (
            lambda: mi.PulseAndHold(amplitude=1.0, width=1.0, hold=1.0, pause=1.0, duration=2.0),
            "duration = 2: must be above 2",
        ),
    ],
)
def test_wrong_times(make, message):
    with pytest.raises(mi.InvalidParameter, match=message):
        make()


@pytest.mark.slow
def test_a_contact_that_opens_when_its_charge_has_left():
    """The voltage in the contact decays by RC from 140 V to 15 V, below the resting voltage."""
    natural = 2.0 * math.pi * math.sqrt(SWITCH.m2 / SWITCH.k)
    capacitance = 2.0 * SWITCH.alpha / (SWITCH.d - SWITCH.delta)
    delay = 25.0 * natural
    device = SWITCH.adding(mi.SeriesResistance(resistance=delay / capacitance))
    drive = mi.PulseAndHold(amplitude=140, width=20 * delay, pause=1e-9, hold=15)
    held = mi.resting_voltage(SWITCH)
    release = drive.switching_time + delay * math.log((140 - 15) / (held - 15))
    assert release > drive.switching_time + 8.0 * natural
    found = mi.closing(device, drive, options=INTERPRETED)
    assert found.run.end > release
    assert math.isnan(found.settling_time)
    before = mi.closing(device, drive, duration=0.99 * release, options=INTERPRETED)
    assert before.settling_time < drive.width
    after = mi.closing(device, drive, duration=1.01 * release, options=INTERPRETED)
    assert math.isnan(after.settling_time)


@pytest.mark.slow
@pytest.mark.parametrize("excess", [-1e-3, 1e-3])
def test_a_contact_whose_insulation_charges_opens_where_the_held_voltage_falls_short(excess):
    """Trapped charge leaves ``1 - share`` of the voltage, a million natural periods later."""
    hold = math.sqrt(SWITCH.k * SWITCH.delta / SWITCH.alpha) * (SWITCH.d - SWITCH.delta)
    share = 1.0 - hold / STEP.amplitude + excess
    found = mi.closing(SWITCH.adding(mi.DielectricCharging(share=share, time=60.0)), STEP)
    assert math.isnan(found.settling_time) == (excess > 0.0)
    assert found.closing_time == pytest.approx(27.795e-6, rel=1e-4)


def test_a_closing_time_near_the_least_voltage_has_the_digits_that_are_known():
    """The block lingers at a saddle, from which errors of the integration grow."""
    step = mi.VoltageStep(amplitude=79.94281245942811)
    found = mi.closing(SWITCH, step)
    tight = mi.closing(SWITCH, step, options=mi.Options(rtol=1e-12, atol=1e-14))
    error = abs(found.closing_time - tight.closing_time)
    assert error > 1e-3 * tight.closing_time
    assert found.errors["closing_time"] == pytest.approx(error, rel=0.2)
    assert "closing_time=0.000159 s, impact_speed=0.138814 m/s" in repr(found)
