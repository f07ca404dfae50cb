"""Energy in studies: what the drive gives, against the ledger of the orbit itself."""

import pytest

import mems_impact as mi
from mems_impact.analysis.attractor import InitialCondition, RecurrenceOptions, map_attractors

OPTIONS = mi.Options(method="dop853")
TIGHT = RecurrenceOptions(tolerance=1e-9)


@pytest.mark.parametrize(
    ("terms", "amplitude"),
    [
        ((), 0.24),
        ((mi.SeriesResistance(resistance=0.05),), 0.24),
        ((mi.SeriesResistance(resistance=0.05, current_limit=0.3), mi.SlewRate(rate=0.11)), 0.26),
        ((mi.ChargeDrive(parasitic_capacitance=0.5),), 0.68),
    ],
)
@pytest.mark.nightly
def test_energy_in_is_that_of_the_ledger(terms, amplitude):
    actuator = mi.load_actuator("zhao2004").replace(terms=terms)
    drive = mi.Sine(amplitude=amplitude, omega=0.5)
    start = mi.State(v2=1.0)
    plain = actuator.under(drive)
    found, other = map_attractors(
        [InitialCondition(plain.with_energy(), start), InitialCondition(plain, start)],
        TIGHT,
        OPTIONS,
    )
    assert found.motion == "periodic"
    orbit = mi.find_orbit(actuator, drive, guess=found.final, periods=found.period)
    given = mi.energy(orbit).input
    assert found.measures["energy in per period"] == pytest.approx(given / found.period, rel=1e-6)
    for name, value in other.measures.items():
        assert found.measures[name] == pytest.approx(value, rel=1e-6, nan_ok=True), name
    assert "energy in per period" not in other.measures
