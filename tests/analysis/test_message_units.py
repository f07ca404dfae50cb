"""Numbers in messages: those of the user, with units, where the numerics count in others."""

import math

import pytest

import mems_impact as mi

INTERPRETED = mi.Options(engine="interpreted")
SHORT = mi.RecurrenceOptions(transient=1, periods=1, exponents="none")
TYPICAL = {"typical": {"x": 1e-6, "time": 1e-3}, "initial": {"x": 1e-6}}
UNITS = {"x": "m", "v": "m/s", "time": "s", "w": "rad/s", "late": "s", "m": "m"}


def well(mode, t, y, p):
    """Equilibria at sqrt(m - 1e-6), as long as there is such a root."""
    return 1e3 * (math.sqrt(p.m - 1e-6) - 1e3 * y.x), -1e3 * y.v


def test_ends_of_equilibria():
    units = {name: UNITS[name] for name in ("x", "v", "time", "m")}
    system = mi.System(
        states=("x", "v"), flow=well, parameters={"m": 4e-6}, units=units, **TYPICAL
    )  # fmt: skip
    found, *_ = mi.find_equilibria(system, guess={"x": 1e-6})
    branch = mi.continue_solution(found, "m", stop=1e-7)
    last = branch.equilibria[-1]
    value = last.system.parameters["m"]
    assert 1e-6 < value < 1.2e-6  # differences look a little beyond it
    assert branch.ended.startswith(
        f"no further step possible beyond m = {value:.9g} m: the flow is not defined at x = "
    )
    x, v = branch.ended.partition(" at x = ")[2].partition(": ")[0].split(", v = ")
    assert (x.split()[1], v) == ("m", "0 m/s")
    assert float(x.split()[0]) == pytest.approx(last.state.x, rel=0.01)


def spiral(mode, t, y, p):
    """A rotation that slowly gets faster, and out of step with itself."""
    return 1e3 * y.v * (1.0 + 1e3 * abs(y.x)), -1e3 * y.x + 0.1 * y.v


@pytest.mark.slow
def test_a_motion_that_does_not_return(monkeypatch):
    from mems_impact.orbits import period_detection

    monkeypatch.setattr(period_detection, "MAX_STEPS", 300)
    units = {name: UNITS[name] for name in ("x", "time")}
    system = mi.System(states=("x", "v"), flow=spiral, units=units, **TYPICAL)
    monkeypatch.setattr(period_detection, "first_return", lambda *_, **__: 0)
    with pytest.raises(mi.OrbitError, match=r"within a time of \S+ s;") as caught:
        mi.find_orbit(system, options=INTERPRETED)
    lasted = float(str(caught.value).partition("within a time of ")[2].split()[0])
    assert 1e-3 < lasted < 10.0


def swing(mode, t, y, p):
    jump = 0.5 if t % (2.0 * math.pi / p.w) < p.late else 0.0
    if y.x > 1.5e-6:
        return math.sqrt(-y.x), 0.0
    return y.v, -4e7 * y.x - 100.0 * y.v + jump * math.cos(p.w * t)


def period(p):
    return 2.0 * math.pi / p.w


def switches(p):
    return (p.late,)


@pytest.fixture
def swinging():
    return mi.System(
        states=("x", "v"), flow=swing, parameters={"w": 6e3, "late": 5e-4}, period=period,
        switches=switches, units={name: UNITS[name] for name in ("x", "v", "time", "w", "late")},
        **TYPICAL,
    )  # fmt: skip


def test_times_beyond_the_period(swinging):
    with pytest.raises(mi.InvalidParameter) as caught:
        swinging.changed(late=2e-3)
    assert str(caught.value) == (
        "switches = (0.002,): must be ascending times above 0 and up to the period, 0.0010472 s"
    )


@pytest.mark.parametrize("name", ["period", "time_scale"])
def test_times_that_are_not_positive(name):
    units = {name: UNITS[name] for name in ("x", "time")}
    with pytest.raises(mi.InvalidParameter) as caught:
        mi.System(states=("x", "v"), flow=relaxing, units=units, **{name: -6e-3}, **TYPICAL)
    assert str(caught.value) == f"{name} = -0.006: must be finite and above 0"


def test_reasons_in_rows(swinging):
    table = mi.operating_map(
        swinging, x=("late", [5e-4, 2e-3]), y=("w", [6e3, 6.1e3]), recurrence=SHORT,
        initial={"x": 1.6e-6}, options=INTERPRETED,
    ).table  # fmt: skip
    fails = table[table["late"] == 5e-4]["status"].iloc[0]
    assert "math domain error at x = 1.6e-06, v = 0, t = 0" in fails
    assert "up to the period, 0.0010472 s" in table[table["late"] == 2e-3]["status"].iloc[0]
    device = mi.load_actuator("mita2003")
    drive = mi.Sine(amplitude=60.0, omega=6e2)
    table = mi.operating_map(
        device, drive, x=("delta", [2e-6, 6e-6]), y=("amplitude", [50.0, 60.0]), recurrence=SHORT,
        options=mi.Options(engine="interpreted", max_steps=5),
    ).table  # fmt: skip
    for status in table["status"]:
        assert " m" in status
    assert "must be < 5e-06 m, the gap d" in table["status"].iloc[1]


def test_a_period_is_in_the_users_time():
    units = {name: UNITS[name] for name in ("x", "time")}
    system = mi.System(states=("x", "v"), flow=relaxing, units=units, **TYPICAL)
    orbit = mi.find_orbit(system, transient=0.05, period=6e-3, options=INTERPRETED)
    assert orbit.period == pytest.approx(2e-3 * math.pi, rel=1e-9)


def relaxing(mode, t, y, p):
    """A cycle of radius 1e-6, reached within some turns."""
    pull = 1.0 - (y.x * y.x + y.v * y.v) * 1e12
    return 1e3 * (y.v + 0.02 * y.x * pull), 1e3 * (-y.x + 0.02 * y.v * pull)


def test_a_diverged_motion():
    units = {name: UNITS[name] for name in ("x", "time")}
    system = mi.System(states=("x",), flow=growing, units=units, **TYPICAL)
    with pytest.raises(mi.OrbitError, match=r"has diverged: x = \S+ m at t = \S+ s;"):
        mi.find_orbit(system, options=INTERPRETED)


def growing(mode, t, y, p):
    return (1e3 * y.x,)


def test_where_a_branch_may_go():
    device = mi.load_actuator("mita2003").replace(c=1e-3)
    drive = mi.Sine(amplitude=20.0, omega=1500.0)
    orbit = mi.find_orbit(device, drive, options=mi.Options(method="dop853", engine="interpreted"))
    with pytest.raises(mi.InvalidParameter, match="another value than 20 V, where the orbit is"):
        mi.continue_solution(orbit, "amplitude", stop=20.0)
    with pytest.raises(mi.InvalidParameter, match="back = 21: must be 20 V, or on the other"):
        mi.continue_solution(orbit, "amplitude", stop=22.0, back=21.0)
