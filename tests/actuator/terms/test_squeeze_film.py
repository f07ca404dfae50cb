"""The squeeze film: its circuit against Blech's series."""

import math
import warnings

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.equations import X2
from mems_impact.actuator.model import compose

pytestmark = pytest.mark.filterwarnings("ignore::mems_impact.errors.ValidityWarning")

INTERPRETED = mi.Options(engine="interpreted", rtol=1e-10, atol=1e-12)
ZHAO = mi.load_actuator("zhao2004")
FILM = mi.SqueezeFilm(length=1.0, width=0.5, pressure=2.0, viscosity=1.0, free_path_pressure=0.1)
DRIVE = mi.Sine(amplitude=0.6, omega=0.5)


def blech(number, ratio, terms=200):
    """Stiffness and damping x frequency by pressure area/gap: Blech's (18), (19), term by term."""
    k = np.arange(1.0, 2.0 * terms, 2.0)
    m, n = np.meshgrid(k, k)
    q = m**2 + (ratio * n) ** 2
    series = (m * n) ** 2 * (q**2 + number**2 / math.pi**4)
    spring = 64.0 * number**2 / math.pi**8 * (1.0 / series).sum()
    damper = 64.0 * number / math.pi**6 * (q / series).sum()
    return spring + 1j * damper


def response(film, number, x2=0.0, d=1.0):
    """The same of the term: rates and force linear in its states, the gap standing still."""
    system = ZHAO.replace(d=d).adding(film).under(DRIVE)
    model = compose(system._kinds, 1)
    p, n = np.array(system.numbers().parameters), len(system.states)

    def rates(y):
        return np.array([rate(0.0, 0.0, y, p) for rate in model.rates])

    y = np.zeros(n)
    y[X2] = x2
    each = np.eye(n)
    slopes = np.array([rates(y + unit) for unit in each])
    relaxing, by_speed = slopes[4:].T, slopes[3]
    forces = np.array([model.force(y + unit, p) for unit in each[4:]])
    gap, mu = d - x2, film.viscosity
    mu /= 1.0 + 9.638 * (film.free_path_pressure / film.pressure / gap) ** 1.159
    omega = number * film.pressure * gap**2 / (12.0 * mu * film.width**2)
    states = np.linalg.solve(1j * omega * np.eye(n - 4) - relaxing, 1j * omega * by_speed)
    return -forces @ states * gap / (film.pressure * film.length * film.width)


@pytest.mark.parametrize(
    ("modes", "ratio", "moderate", "always"),
    [
        (1, 1.0, 0.010, 0.10),
        (1, 0.5, 0.026, 0.09),
        (1, 0.1, 0.018, 0.06),
        (2, 1.0, 0.001, 0.06),
        (2, 0.5, 0.004, 0.046),
        (2, 0.1, 0.015, 0.031),
        (4, 1.0, 5e-5, 0.032),
    ],
)
def test_force_is_that_of_blechs_series(modes, ratio, moderate, always):
    """Squeeze numbers up to 30, where most devices are, and beyond."""
    film = FILM.replace(width=ratio, modes=modes)
    numbers = 10.0 ** np.arange(-2.0, 4.1, 0.5)
    series = np.array([blech(number, ratio) for number in numbers])
    apart = np.abs([response(film, number) for number in numbers] - series) / np.abs(series)
    assert apart[numbers < 32.0].max() < moderate
    assert apart.max() < always


@pytest.mark.parametrize("x2", [0.0, 0.4, -0.4])
def test_a_long_plate_at_low_frequency_is_damped_by_the_known_coefficient(x2):
    """Damping mu L w^3/g^3, less the flow out at the ends: 1 - 0.630 w/L."""
    film = FILM.replace(length=1.0, width=0.01, free_path_pressure=0.0)
    number, gap = 1e-4, 1.0 - x2
    omega = number * film.pressure * gap**2 / (12.0 * film.viscosity * film.width**2)
    damping = response(film, number, x2).imag * film.pressure * 0.01 / gap / omega
    closed = film.viscosity * film.width**3 / gap**3 * (1.0 - 0.630 * film.width)
    assert damping == pytest.approx(closed, rel=1e-5)


@pytest.mark.parametrize("modes", [1, 2, 3, 4])
def test_at_high_frequency_it_is_an_isothermal_spring(modes):
    found = response(FILM.replace(modes=modes), 1e9)
    assert found.real == pytest.approx(1.0, abs=1e-6)


def test_rarefied_gas_flows_out_as_fast_as_veijola_has_it():
    """At Kn = 0.1 the effective viscosity is that of the gas by 1.66832."""
    film = FILM.replace(free_path_pressure=0.2)
    thinner = film.replace(free_path_pressure=0.0, viscosity=film.viscosity / 1.66832379)
    systems = [ZHAO.adding(each).under(DRIVE) for each in (film, thinner)]
    slopes = []
    for system in systems:
        model, p = compose(system._kinds, 1), np.array(system.numbers().parameters)
        y = np.array([0.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3])
        slopes.append([rate(0.0, 0.0, y, p) for rate in model.rates])
    assert slopes[0] == pytest.approx(slopes[1], rel=1e-6)


@pytest.mark.parametrize("sides", ["right", "both"])
def test_no_energy_comes_of_it(sides):
    """Of large changes of gap and pressure: what is pushed in is stored or lost, and losses are."""
    system = ZHAO.adding(FILM.replace(sides=sides)).under(DRIVE)
    model = compose(system._kinds, 1)
    p, n = np.array(system.numbers().parameters), len(system.states)
    (part,) = model.contributions
    rng = np.random.default_rng(1)
    for _ in range(20):
        y = rng.uniform(-0.3, 0.6, n)
        y[X2] = rng.uniform(-0.5, 0.5)
        slope = np.zeros(n)
        slope[X2] = y[3]
        slope[4:] = [rate(0.0, 0.0, y, p) for rate in model.rates]
        h = 1e-7
        stored = (part.energy(y + h * slope, p) - part.energy(y - h * slope, p)) / (2.0 * h)
        assert part.energy(y, p) > 0.0
        assert part.dissipation(y, p) >= 0.0
        assert stored + part.dissipation(y, p) == pytest.approx(-part.force(y, p) * y[3], abs=1e-7)


@pytest.mark.filterwarnings("default::mems_impact.errors.ValidityWarning")
def test_a_run_beyond_what_holds_says_so_once():
    def told(speed, **changes):
        device, start = ZHAO.adding(FILM.replace(**changes)), mi.State(v2=speed)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            mi.simulate(device, DRIVE, periods=0.2, initial=start, options=INTERPRETED)
        return [str(each.message) for each in caught if each.category is mi.ValidityWarning]

    assert told(0.1) == []
    (pressed,) = told(1.0)
    assert pressed.startswith("the excess of the squeeze film's mean pressure")
    assert pressed.endswith("and the model is valid up to 0.2")
    (rarefied,) = told(0.1, viscosity=1e5, free_path_pressure=1700.0)
    assert rarefied == (
        "the Knudsen number of the squeeze film is 1.28e+03 at t = 1.25664, "
        "and the model is valid up to 880"
    )


@pytest.mark.parametrize("values", [{"width": 2.0}, {"modes": 5}, {"sides": "left"}])
def test_what_is_refused(values):
    with pytest.raises(mi.InvalidParameter):
        FILM.replace(**values)
