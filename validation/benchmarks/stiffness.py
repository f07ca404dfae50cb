"""Systems whose stiffness goes from none to extreme, by each method and by what else is at hand.

An electrostatic oscillator behind a resistor, whose charge is a state that follows the voltage
within a part of the period; and an oscillator that strikes a compliant stopper (K. H. Hunt,
F. R. E. Crossley, J. Appl. Mech. 42, 1975), ever harder. Each contestant runs at the loosest of its
tolerances whose error at the end is below one bound, the end being that of SciPy's Radau, tightly.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace

import numpy as np
from scipy.integrate import solve_ivp

import mems_impact as mi
from mems_impact.errors import RunError, StiffnessWarning
from mems_impact.hybrid.simulation import run
from validation.benchmarks.timing import Row, in_turn, scaled

PERIODS, WITHIN = 4, 1e-6
TOLERANCES = [10.0**-k for k in range(4, 13)]
SHARE = 0.01  # atol/rtol
REFERENCE = 3e-12
MOST_STEPS = 300_000  # of an arc; what takes more has lost

FREE, TOUCHING = mi.modes("free", "touching")
State = np.ndarray


def charged(mode, t, y, p):
    force = 0.5 * y.q * y.q
    charging = (p.A * math.cos(p.omega * t) - y.q * (1.0 - y.x)) / p.RC
    return y.v, force - y.x - p.c * y.v, charging


def electrode(mode, t, y, p):
    return p.d - y.x


def rebound(mode, t, y, p):
    return mode, (p.d, -p.e * y.v, y.q)


CIRCUIT = mi.System(
    states=("x", "v", "q"),
    flow=charged,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"A": 0.4, "omega": 0.5, "c": 0.05, "d": 0.3, "e": 0.7, "RC": 1e-2},
    guards=[mi.Impact("electrode", electrode, rebound)],
    initial={"x": 0.0, "v": 0.0, "q": 0.4},
)


def struck(mode, t, y, p):
    depth = max(y.x - p.d, 0.0)
    contact = p.K * depth * math.sqrt(depth) * (1.0 + p.loss * y.v) if mode == TOUCHING else 0.0
    return y.v, p.A * math.cos(p.omega * t) - y.x - p.c * y.v - contact


def room(mode, t, y, p):
    return p.d - y.x


def depth(mode, t, y, p):
    return y.x - p.d


STOPPER = mi.System(
    states=("x", "v"),
    flow=struck,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"A": 0.6, "omega": 0.8, "c": 0.1, "d": 1.0, "K": 1e2, "loss": 0.3},
    modes=("free", "touching"),
    guards=[
        mi.Guard("touches", room, lambda mode, t, y, p: (TOUCHING, (y.x, y.v)), modes=(FREE,)),
        mi.Guard("leaves", depth, lambda mode, t, y, p: (FREE, (y.x, y.v)), modes=(TOUCHING,)),
    ],
    initial={"x": 0.0, "v": 1.2},
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A system, and what a loop by hand must know of it.

    `guards` are margins by mode with what they lead to.
    """

    name: str
    system: mi.System
    flow: Callable
    guards: dict[int, tuple[Callable, Callable]]

    @property
    def parameters(self) -> SimpleNamespace:
        return SimpleNamespace(**self.system.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        return self.system.states

    @property
    def end(self) -> float:
        return PERIODS * 2.0 * math.pi / self.system.parameters["omega"]

    @property
    def start(self) -> list[float]:
        return [float(self.system.initial.as_dict().get(name, 0.0)) for name in self.names]


def cases(quick: bool) -> Iterator[Case]:
    circuit = {FREE: (electrode, rebound)}
    for share in (1e-2, 1e-4, 1e-6) if not quick else (1e-2, 1e-6):
        rc = share * 2.0 * math.pi / CIRCUIT.parameters["omega"]
        yield Case(f"RC {share:.0e} of a period", CIRCUIT.changed(RC=rc), charged, circuit)
    stopper = {
        FREE: (room, lambda mode, t, y, p: (TOUCHING, (y.x, y.v))),
        TOUCHING: (depth, lambda mode, t, y, p: (FREE, (y.x, y.v))),
    }
    for k in (1e2, 1e5, 1e8) if not quick else (1e2, 1e8):
        yield Case(f"stopper {k:.0e} k", STOPPER.changed(K=k), struck, stopper)


def package(case: Case, method: str, rtol: float) -> Callable[[], State]:
    options = mi.Options(method=method, rtol=rtol, atol=SHARE * rtol, max_steps=MOST_STEPS)
    problem = case.system.problem(options)
    start = case.system.state_space.instant(None, problem)
    return lambda: run(problem, start, PERIODS).final.y


def _told(case: Case) -> tuple[Callable, Callable]:
    """Return flow and state as the functions of a case take them, fast enough for a fair loop."""
    return case.parameters, lambda y: SimpleNamespace(**dict(zip(case.names, y, strict=True)))


def scipy(case: Case, method: str, rtol: float) -> Callable[[], State]:
    p, named = _told(case)

    def go() -> State:
        t, y, mode = 0.0, np.array(case.start), FREE
        while True:
            margin, transition = case.guards[mode]

            def event(t, y, mode=mode, margin=margin):
                return margin(mode, t, named(y), p)

            event.terminal, event.direction = True, -1
            flow = partial(lambda mode, t, y: case.flow(mode, t, named(y), p), mode)
            done = solve_ivp(flow, (t, case.end), y, method=method, rtol=rtol,
                             atol=SHARE * rtol, events=event)  # fmt: skip
            if not done.success:
                raise RuntimeError(done.message)
            t, y = float(done.t[-1]), done.y[:, -1]
            if done.status == 0:
                return y
            mode, after = transition(mode, t, named(y), p)
            y = np.array(after)

    return go


def sundae(case: Case, rtol: float) -> Callable[[], State]:
    """CVODE's BDF through scikit-sundae, begun anew at every event."""
    from sksundae.cvode import CVODE

    p, named = _told(case)
    at = SimpleNamespace(mode=FREE)

    def rhs(t, y, out):
        out[:] = case.flow(at.mode, t, named(y), p)

    def events(t, y, out):
        out[0] = case.guards[at.mode][0](at.mode, t, named(y), p)

    def go() -> State:
        events.terminal, events.direction = [True], [-1]
        t, y, at.mode = 0.0, np.array(case.start), FREE
        while True:
            solver = CVODE(rhs, method="BDF", rtol=rtol, atol=SHARE * rtol, eventsfn=events,
                           num_events=1, max_num_steps=MOST_STEPS)  # fmt: skip
            done = solver.solve(np.array([t, case.end]), y)
            if not done.success:
                raise RuntimeError(done.message)
            t, y = float(done.t[-1]), np.array(done.y[-1])
            if t >= case.end:
                return y
            at.mode, after = case.guards[at.mode][1](at.mode, t, named(y), p)
            y = np.array(after)

    return go


def loosest(
    solver: Callable[[float], Callable[[], State]], truth: State
) -> tuple[float, float] | None:
    """Return the loosest tolerance that keeps the error, and the error; None if none does."""
    for rtol in TOLERANCES:
        try:
            error = float(np.abs(solver(rtol)() - truth)[:2].max())
        except (RunError, RuntimeError):
            return None
        if error < WITHIN:
            return rtol, error
    return None


def stiffness(quick: bool) -> Iterator[Row]:
    """All contestants over a scale of stiffness."""
    import warnings

    warnings.simplefilter("ignore", StiffnessWarning)
    topic = f"stiffness, error < {WITHIN:g}"
    for case in cases(quick):
        truth = scipy(case, "Radau", REFERENCE)()
        solvers = {method: partial(package, case, method)
                   for method in ("auto", "bdf", "dop853", "adams")}  # fmt: skip
        solvers |= {f"SciPy {m}": partial(scipy, case, m) for m in ("Radau", "BDF", "LSODA")}
        solvers["scikit-sundae by hand"] = partial(sundae, case)
        jobs = {}
        for name, solver in solvers.items():
            found = loosest(solver, truth)
            if found is None:
                continue
            jobs[f"{name}, rtol {found[0]:.0e}"] = solver(found[0])
        seconds = in_turn(jobs, 3, time.process_time)
        for name, measured in seconds.items():
            yield Row(topic, case.name, name, scaled(measured, 1e6 / PERIODS), "us a period")
