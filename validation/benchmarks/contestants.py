"""The same actuator by this package and by the loops that a user would write instead.

Each contestant is a function of the number of forcing periods that returns the final state.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from sksundae.cvode import CVODE

from mems_impact.actuator.device_files import load_actuator
from mems_impact.actuator.drives import Sine
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Trajectory, run
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options
from validation.judges.heyoka_free import Heyoka

START = (0.0, 0.0, 0.0, 0.3)
DEVICE = dict(load_actuator("zhao2004"))

RIGHT, LEFT, SLIP_END, BREAK_AWAY = range(4)
LEAN, WATCHFUL = 3, 8  # events of a plain loop, and of one that misses no graze and no break-away


@dataclass(frozen=True)
class Case:
    """A drive of the paper's set of parameters."""

    name: str
    amplitude: float
    omega: float

    @property
    def period(self) -> float:
        return math.pi / self.omega


PERIODIC = Case("periodic (omega 0.5, f 0.24)", 0.24, 0.5)
CHAOTIC = Case("chaotic (omega 0.45, f 0.25)", 0.25, 0.45)
CASES = (PERIODIC, CHAOTIC)


def package(
    case: Case,
    engine: str = "compiled",
    rtol: float = 1e-9,
    atol: float | None = None,
    section: bool = False,
    method: str = "adams",
) -> Callable[[float], Trajectory]:
    """This package's event loop with all its guards; the section x2 = 0 only on demand."""
    drive = Sine(amplitude=case.amplitude, omega=case.omega)
    system = load_actuator("zhao2004").under(drive)
    problem = Problem(
        automaton=system.automaton,
        parameters=system.numbers().parameters,
        period=drive.period,
        section=(2, 0.0, 1) if section else None,
        options=Options(
            method=method, engine=engine, rtol=rtol, atol=0.01 * rtol if atol is None else atol
        ),
    )
    return lambda periods: run(problem, HybridState(0, 0.0, 0, np.array(START)), periods)


def heyoka(case: Case, tol: float, break_away: bool = True) -> Callable[[float], np.ndarray]:
    """The judge of the tests: compiled once, Python between arcs only."""
    rival = Heyoka(DEVICE, tol, break_away)
    drive = (case.amplitude, case.omega, 0.0)
    return lambda periods: rival.run(drive, START, periods * case.period)


def heyoka_batch(case: Case, tol: float, width: int) -> Callable[[float], np.ndarray]:
    """Trajectories in batches, transitions as callbacks; amplitudes differ by up to two percent."""
    integrator = Heyoka(DEVICE, tol).batch(width)
    drives = np.zeros((4, width))
    drives[1] = case.amplitude * np.linspace(0.98, 1.02, width)
    drives[2] = case.omega

    def go(periods: float) -> np.ndarray:
        integrator.reset_cooldowns()
        integrator.set_time(0.0)
        integrator.state[:] = np.array(START)[:, None]
        integrator.pars[:] = drives
        integrator.propagate_until(periods * case.period)
        return integrator.state.copy()

    return go


class _Plain:
    """Equations (1) to (6) in plain Python, as one writes them for a solver with callbacks."""

    def __init__(self, case: Case) -> None:
        p = DEVICE
        self.case = case
        self.m1, self.m2, self.k, self.c = p["m1"], p["m2"], p["k"], p["c"]
        self.d, self.delta, self.e, self.alpha = p["d"], p["delta"], p["e"], p["alpha"]
        weight = (p["m1"] + p["m2"]) * p["g"]
        self.static, self.dynamic = p["mu_s"] * weight, p["mu_d"] * weight
        self.slip = 0.0

    def load(self, t: float, x2: float, v2: float) -> float:
        voltage = self.case.amplitude * math.cos(self.case.omega * t)
        gap = self.d - x2
        return self.k * x2 + self.c * v2 - self.alpha * voltage * voltage / (gap * gap)

    def rhs(self, t: float, y: np.ndarray, dy: np.ndarray) -> None:
        _, v1, x2, v2 = y
        load = self.load(t, x2, v2)
        frame = (load - self.slip * self.dynamic) / self.m1 if self.slip else 0.0
        dy[0], dy[1], dy[2], dy[3] = v1, frame, v2, -load / self.m2 - frame

    def flow(self, t: float, y: np.ndarray) -> tuple[float, float, float, float]:
        _, v1, x2, v2 = y
        load = self.load(t, x2, v2)
        frame = (load - self.slip * self.dynamic) / self.m1 if self.slip else 0.0
        return v1, frame, v2, -load / self.m2 - frame

    def events(self) -> list[Callable[[float, np.ndarray], float]]:
        """Return the margins of the events, and from the fifth on the rates of these margins."""
        return [
            lambda t, y: self.delta - y[2],
            lambda t, y: self.delta + y[2],
            lambda t, y: self.slip * y[1] if self.slip else 1.0,
            lambda t, y: 1.0 if self.slip else self.static - abs(self.load(t, y[2], y[3])),
            lambda t, y: -y[3],
            lambda t, y: y[3],
            lambda t, y: self.slip * self.flow(t, y)[1] if self.slip else 1.0,
            lambda t, y: 1.0 if self.slip else self.limit_rate(t, y[2], y[3]),
        ]

    def limit_rate(self, t: float, x2: float, v2: float) -> float:
        """The rate at which the load on the stuck frame moves away from the static limit."""
        angle, gap = self.case.omega * t, self.d - x2
        voltage = self.case.amplitude * math.cos(angle)
        slope = -self.case.amplitude * self.case.omega * math.sin(angle)
        pull = self.alpha * voltage * voltage / (gap * gap)
        load = self.k * x2 + self.c * v2 - pull
        by_drive = 2.0 * self.alpha * voltage * slope / (gap * gap)
        rate = self.k * v2 - self.c * load / self.m2 - by_drive - 2.0 * pull * v2 / gap
        return -rate if load > 0.0 else rate

    def look(self, t: float, y: np.ndarray) -> None:
        """Raise at a closest approach that is a contact: a step went over two crossings."""
        if min(margin(t, y) for margin in self.events()[:4]) < 0.0:
            raise RuntimeError(f"events were missed before t = {t}")

    def transit(self, kind: int, t: float, y: np.ndarray) -> None:
        if kind in (SLIP_END, BREAK_AWAY):
            y[1] = 0.0
            load = self.load(t, y[2], y[3])
            self.slip = math.copysign(1.0, load) if abs(load) > self.static else 0.0
        else:
            y[2] = self.delta if kind == RIGHT else -self.delta
            y[1] += (1.0 + self.e) * self.m2 * y[3] / (self.m1 + self.m2)
            y[3] *= -self.e
            self.slip = math.copysign(1.0, y[1])


def scikit_sundae(
    case: Case, rtol: float = 1e-9, watched: int = LEAN
) -> Callable[[float], np.ndarray]:
    """A loop around scikit-sundae with Python callbacks, restarted at every event.

    It watches impacts and the ends of slips and nothing else; or, `WATCHFUL`, what this package
    watches too: break-away, and the closest approach to every guard.
    """
    model = _Plain(case)
    functions = model.events()[:watched]

    def events(t: float, y: np.ndarray, g: np.ndarray) -> None:
        for i in range(watched):
            g[i] = functions[i](t, y)

    events.direction = [-1 if i < 4 else 1 for i in range(watched)]  # type: ignore[attr-defined]
    options = {"rtol": rtol, "atol": 0.01 * rtol, "max_num_steps": 100_000}
    solver = CVODE(model.rhs, method="adams", eventsfn=events, num_events=watched, **options)

    def go(periods: float) -> np.ndarray:
        t, end, y = 0.0, periods * case.period, np.array(START)
        model.slip = 0.0
        solver.init_step(t, y)
        while True:
            # Its log of events grows for ever and slows every step: in its favour, cleared.
            for log in (events._i, events._t, events._y):  # type: ignore[attr-defined]
                log.clear()
            result = solver.step(end, method="normal")
            t, y = float(np.ravel(result.t)[-1]), np.array(result.y, dtype=float).reshape(-1, 4)[-1]
            if result.t_events is None or t >= end:
                return y
            kind = int(np.flatnonzero(result.i_events[-1])[0])
            if kind > BREAK_AWAY:
                model.look(t, y)
                continue
            model.transit(kind, t, y)
            solver.init_step(t, y)

    return go


def scipy_ivp(
    case: Case, method: str, rtol: float = 1e-9, watched: int = LEAN
) -> Callable[[float], np.ndarray]:
    """A loop around `scipy.integrate.solve_ivp` with terminal events, watching as above."""
    model = _Plain(case)
    events = model.events()[:watched]
    for i, event in enumerate(events):
        event.terminal = i <= BREAK_AWAY  # type: ignore[attr-defined]
        event.direction = -1 if i <= BREAK_AWAY else 1  # type: ignore[attr-defined]
    options = {"method": method, "rtol": rtol, "atol": 0.01 * rtol}

    def go(periods: float) -> np.ndarray:
        t, end, y = 0.0, periods * case.period, np.array(START)
        model.slip = 0.0
        while True:
            result = solve_ivp(model.flow, (t, end), y, events=events, **options)
            for times, states in zip(result.t_events[4:], result.y_events[4:], strict=True):
                for when, state in zip(times, states, strict=True):
                    model.look(when, state)
            t, y = float(result.t[-1]), result.y[:, -1].copy()
            if result.status != 1:
                return y
            model.transit(next(i for i in range(4) if result.t_events[i].size), t, y)

    return go
