"""Friction by speed: Stribeck's, and the one that is smoothed about rest."""

import math

import pytest
from scipy.integrate import quad

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004")
SILENT = mi.Sine(amplitude=1e-9, omega=0.5)
PRECISE = mi.Options(engine="interpreted", method="dop853", rtol=1e-11, atol=1e-13)
STRIBECK = mi.StribeckFriction(speed=0.1, viscous=0.3)


def test_slip_after_an_impact():
    # Nothing but friction acts on the frame: m1 v dv/dx = -mu(v) N.
    device = ZHAO.replace(k=1e-9, c=0.0).adding(STRIBECK)
    start = mi.State(x2=0.5, v2=1.0)
    run = mi.simulate(device, SILENT, duration=0.2, initial=start, options=PRECISE)
    hit, end = run.impacts.iloc[0], run.events.query("event == 'slip end'").iloc[0]

    def coefficient(v):
        return 0.27 + (0.4 - 0.27) * math.exp(-((v / 0.1) ** 2)) + 0.3 * v

    weight, first = 6.0 * 9.81, hit["v1 after"]
    assert first == pytest.approx(1.8 / 6.0, rel=1e-9)
    length = quad(lambda v: 5.0 * v / (coefficient(v) * weight), 0.0, first, epsabs=1e-14)[0]
    lasts = quad(lambda v: 5.0 / (coefficient(v) * weight), 0.0, first, epsabs=1e-14)[0]
    assert hit["step"] == pytest.approx(length, rel=1e-8)
    assert end["t"] - hit["t"] == pytest.approx(lasts, rel=1e-8)


def test_creep_of_regularised_friction():
    device = ZHAO.replace(c=1.0).adding(
        mi.RegularizedFriction(width=1e-2), mi.FrameForce(force=5.0)
    )
    stiff = mi.Options(engine="interpreted", method="bdf", rtol=1e-9, atol=1e-12)
    run = mi.simulate(device, SILENT, duration=40.0, options=stiff)
    held = 0.27 * 6.0 * 9.81
    assert run.final.v1 == pytest.approx(-1e-2 * math.atanh(5.0 / held), rel=1e-5)
    assert run.statistics["share slipping"] == pytest.approx(1.0)
    exact = ZHAO.replace(c=1.0).adding(mi.FrameForce(force=5.0))
    assert mi.simulate(exact, SILENT, duration=40.0, options=PRECISE).final.x1 == 0.0


@pytest.mark.parametrize("device", [ZHAO, mi.load_actuator("mita2003")], ids=["unit", "SI"])
def test_a_width_that_the_tolerances_do_not_resolve_is_refused_with_those_that_do(device):
    speed = device.scales.unit("m/s")
    drive = mi.Sine(amplitude=0.24 * device.scales.unit("V"), omega=0.5 / device.scales.unit("s"))
    narrow = device.adding(mi.RegularizedFriction(width=1e-9 * speed))
    refused = r"regularized_friction.width = .* at atol = 1e-11, .* atol = 1e-1[23] "
    with pytest.raises(mi.InvalidParameter, match=refused):
        mi.simulate(narrow, drive, 1)
    with pytest.raises(mi.InvalidParameter, match=refused):
        mi.find_orbit(narrow.under(drive), options=mi.Options())


@pytest.mark.nightly
def test_events_are_those_of_any_width_where_the_tolerances_resolve_it():
    """Integration errors missed two events here, and ended runs at narrower widths."""
    drive, counts = mi.Sine(amplitude=0.24, omega=0.5), set()
    for width, atol in ((1e-6, 1e-11), (1e-8, 1e-11), (1e-9, 1e-12), (1e-10, 1e-13)):
        device = ZHAO.adding(mi.RegularizedFriction(width=width))
        run = mi.simulate(device, drive, periods=4, options=mi.Options(atol=atol))
        counts.add(tuple(run.events["event"]))
        assert run.final.v1 / width == pytest.approx(-7.89672e-3, rel=1e-4)
    assert len(counts) == 1
