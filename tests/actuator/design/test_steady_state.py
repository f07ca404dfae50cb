"""Devices whose frame slips for a long time: every verb has the speed of the periodic orbit."""

import pytest

import mems_impact as mi


@pytest.fixture(scope="module")
def slipping():
    """Return a device in SI whose frame slips under the force of the block, and its drive."""
    device = mi.Actuator.from_design(
        frequency="10 kHz", quality=10, proof_mass="4 ug", mass_ratio=7, gap="3 um",
        travel="1.8 um", electrode_area="0.07 mm^2", friction=(0.3, 0.2), restitution=0.6,
    )  # fmt: skip
    return device, mi.Sine(amplitude="13 V", frequency="5.2 kHz")


@pytest.fixture(scope="module")
def speed(slipping):
    orbit = mi.find_orbit(*slipping, transient=3000, guess=mi.kicked_state(slipping[0]))
    assert orbit.stable
    return orbit.step / (orbit.periods * orbit.period)


@pytest.mark.parametrize("method", ["adams", "auto"])
def test_a_run_tells_the_limit_and_a_length_that_reaches_it(slipping, speed, method):
    run = mi.simulate(*slipping, periods=300, options=mi.Options(method=method))
    assert run.settling.kind == "changing"
    assert "would settle" in str(run.settling)
    row = run.settling.table.set_index("statistic").loc["mean speed"]
    assert abs(row["value"] / speed - 1.0) > 0.05
    assert row["error"] < 0.1 * abs(speed)
    assert abs(row["limit"] - speed) <= row["error"]
    periods = int(run.settling.periods)
    longer = mi.simulate(*slipping, periods=periods, options=mi.Options(method="auto"))
    assert longer.statistics["mean speed"] == pytest.approx(speed, rel=2e-3)


@pytest.mark.nightly
def test_verbs_of_the_steady_state(slipping, speed):
    device, drive = slipping
    options = mi.Options(method="auto")
    for parameter in ("amplitude", "frequency"):
        (row,) = mi.characteristic(
            device, drive, parameter, [getattr(drive, parameter)], direction="down",
            options=options,
        ).table.to_dict("records")  # fmt: skip
        assert row["mean speed"] == pytest.approx(speed, rel=1e-3)
        assert row["mean speed error"] < 1e-2 * abs(speed)
    curve = mi.force_curve(device, drive, [0.0], options=options)
    assert curve.table["mean speed"].iloc[0] == pytest.approx(speed, rel=1e-3)
