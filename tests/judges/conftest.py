"""The package on the side of the judged: one run of the compiled engine as bare numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from mems_impact.actuator.device_files import load_actuator
from mems_impact.actuator.drives import Sine
from mems_impact.actuator.equations import STATES
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options
from validation.judges.dop853_free import Judge
from validation.judges.heyoka_free import Heyoka

Start = tuple[float, float, float, float]
# The package counts guards, the judges kinds: right impact, left impact, slip end, break-away.
KIND = {0: 0, 1: 1, 3: 2, 4: 3}


@dataclass(frozen=True)
class Case:
    """A device (changes against zhao2004), a drive and an initial state."""

    drive: tuple[float, float, float]  # amplitude, omega, bias
    start: Start = (0.0, 0.0, 0.0, 0.3)
    changes: tuple[tuple[str, float], ...] = ()

    @property
    def actuator(self):  # type: ignore[no-untyped-def]
        return load_actuator("zhao2004").replace(**dict(self.changes))

    @property
    def sine(self) -> Sine:
        amplitude, omega, bias = self.drive
        return Sine(amplitude=amplitude, omega=omega, bias=bias)


@dataclass(frozen=True)
class Result:
    """All events and the last state; times count from the start of the run."""

    kind: np.ndarray
    t: np.ndarray
    after: np.ndarray
    final: np.ndarray

    @classmethod
    def of(cls, rows: list[tuple[int, float, np.ndarray]], final: np.ndarray) -> Result:
        kinds = np.array([row[0] for row in rows], dtype=int)
        times = np.array([row[1] for row in rows], dtype=float)
        return cls(kinds, times, np.array([row[2] for row in rows]).reshape(-1, 4), final)


def by_package(case: Case, periods: float, rtol: float = 1e-11) -> Result:
    sine = case.sine
    system = case.actuator.under(sine)
    automaton, p = system.automaton, system.numbers().parameters
    options = Options(engine="compiled", rtol=rtol, atol=0.1 * rtol)
    problem = Problem(automaton=automaton, parameters=p, period=sine.period, options=options)
    y = np.array(case.start)
    mode, _ = automaton.state_after(0, automaton.switch_code, 0.0, y, p)
    assert automaton.states == STATES
    trajectory = run(problem, HybridState(0, 0.0, mode, y, initial=True), periods)
    events = trajectory.events
    events = events[events.kind == workspace.TRANSITION]
    return Result(
        np.array([KIND[guard] for guard in events.guard.tolist()], dtype=int),
        events.cycle * sine.period + events.time,
        events.after,
        trajectory.final.y,
    )


def by_heyoka(case: Case, periods: float) -> Result:
    rows: list[tuple[int, float, np.ndarray]] = []
    judge = Heyoka(dict(case.actuator))
    return Result.of(rows, judge.run(case.drive, case.start, periods * case.sine.period, rows))


def by_dop853(case: Case, periods: float) -> Result:
    judge = Judge(dict(case.actuator), case.drive)
    return Result.of(*judge.run(case.start, periods * case.sine.period))


@pytest.fixture(params=[by_heyoka, by_dop853], ids=["heyoka", "dop853"])
def judge(request: pytest.FixtureRequest) -> Callable[[Case, float], Result]:
    return request.param
