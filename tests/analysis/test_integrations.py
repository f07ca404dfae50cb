"""How often work is done: segments integrated, functions of the user asked, problems built."""

import math
from collections import Counter

import pytest

import mems_impact as mi
from mems_impact.hybrid.simulation import Simulation
from tests.analysis.oscillators import van_der_pol
from tests.analysis.systems import oscillator


@pytest.fixture
def counted(monkeypatch):
    """Count runs and problems of other parameters."""
    counts = Counter()

    def count(kind, method, name):
        original = getattr(kind, method)

        def counting(self, *arguments, **named):
            counts[name] += 1
            return original(self, *arguments, **named)

        monkeypatch.setattr(kind, method, counting)

    count(Simulation, "go", "runs")
    count(mi.System, "problem", "problems")
    return counts


def forced():
    branch = mi.continue_solution(mi.find_orbit(oscillator(), transient=40), "A", 0.36)
    assert len(branch.special_points) == 2
    return branch


def cycle():
    orbit = mi.find_orbit(van_der_pol(), guess={"x": 2.0})
    return mi.continue_solution(orbit, "mu", 1.1, steps=mi.StepControl(max_points=5))


@pytest.mark.slow
@pytest.mark.parametrize("followed", [cycle, forced])
def test_tables_of_a_branch_integrate_each_segment_once(counted, followed):
    branch = followed()
    counted.clear()
    assert len(branch.table) + len(branch.special_table) > 2
    orbits = {id(orbit.numeric): orbit for orbit in branch.orbits}
    orbits |= {id(special.orbit.numeric): special.orbit for special in branch.special_points}
    lasting = (
        end > max(start, 0.0)
        for orbit in orbits.values()
        for start, end in zip(orbit.numeric.point.starts, orbit.numeric.point.ends, strict=True)
    )
    assert counted["runs"] == sum(lasting)


def spring(asked):
    def period(p):
        asked["period"] += 1
        return 2.0 * math.pi / p.omega

    def flow(mode, t, y, p):
        return y.v, -y.x - 0.2 * y.v + p.A * math.cos(p.omega * t)

    return mi.System(
        states=("x", "v"), flow=flow, parameters={"A": 0.5, "omega": 0.8}, period=period
    )


def test_whether_a_system_is_forced_asks_no_function():
    asked = Counter()
    system = spring(asked)
    asked.clear()
    assert system.forced
    assert system.changed(A=1.0).forced
    assert asked["period"] == 1  # of the other values, which are checked


def test_a_map_builds_a_problem_once_a_point(counted):
    asked = Counter()
    system = spring(asked)
    brief = mi.RecurrenceOptions(transient=10, periods=5, exponents="none")

    def built(*omega):
        asked.clear()
        counted.clear()
        x, y = ("A", [0.1, 0.5, 1.0]), ("omega", omega)
        table = mi.operating_map(system, x=x, y=y, recurrence=brief).table
        assert asked["period"] == len(table)
        assert (table["status"] == "ok").sum() == 3 * sum(each > 0.0 for each in omega)
        return counted["problems"]

    assert built(0.5, 0.8, 1.3, -1.0) - built(0.8) == 6  # those not allowed build none


def test_what_is_remembered_of_a_system_does_not_tell_it_from_another():
    system = spring(Counter())
    fresh = system.shifted({"A": 0.5})
    system.problem(mi.Options())
    assert fresh == system
    assert fresh.shifted({"omega": 0.4}).problem(mi.Options()).period == pytest.approx(5 * math.pi)
