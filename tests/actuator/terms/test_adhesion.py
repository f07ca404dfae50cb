import math

import pytest

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004")
SILENT = mi.Sine(amplitude=1e-9, omega=0.5)
FALLING = mi.Pulse(amplitude=0.45, period=60.0, width=10.0, fall=45.0)
PLAIN = mi.Options(engine="interpreted", method="dop853", rtol=1e-11, atol=1e-13)


def volts_at_release(device, start=0.5, time=8.0):
    run = mi.simulate(device, FALLING, duration=26.0, initial=mi.State(x2=start, time=time),
                      options=PLAIN)  # fmt: skip
    release = run.events.query("event == 'release'").iloc[0]
    return FALLING.value(release["t"])


@pytest.mark.parametrize("force", [0.0, 0.1, 0.3])
def test_release_voltage(force):
    # alpha v^2/(d - delta)^2 + force = k delta
    exact = 0.5 * math.sqrt(0.5 - force)
    assert volts_at_release(ZHAO.adding(mi.Adhesion(force=force))) == pytest.approx(exact, rel=1e-9)


def test_a_stopper_that_yields_lets_go_at_the_same_voltage():
    hard = mi.CompliantStopper(stiffness=1e4, damping=5.0)
    device = ZHAO.replace(c=1.0).adding(hard, mi.Adhesion(force=0.2))
    deep = (float(FALLING.value(26.0)) ** 2 / 0.25 + 0.2 - 0.5) / 1e4
    found = volts_at_release(device, 0.5 + deep, 26.0)
    assert found == pytest.approx(0.5 * math.sqrt(0.5 - 0.2), rel=1e-3)


def test_a_block_that_sticks_never_leaves():
    for force, leaves in ((0.49, True), (0.51, False)):
        device = ZHAO.adding(mi.Adhesion(force=force))
        for side in (1.0, -1.0):
            start = mi.State(x2=0.5 * side)
            run = mi.simulate(device, SILENT, duration=50.0, initial=start, options=PLAIN)
            assert (abs(run.final.x2) < 0.5) is leaves
