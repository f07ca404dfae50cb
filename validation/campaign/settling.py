"""Settling of statistics: limits, errors and steady states of runs, before the attractor itself.

Modes of a linear system with forcing, whose mean rates are known in closed form: real, spiralling,
alternating and undamped, so that the motion is periodic, of any period, or has two frequencies.
Duffing's oscillator, often chaotic, before a run of 5,000 periods. Chaos may end within this run;
an error of a mean of chaos is judged by the longest run that is still chaotic. Random lightly
loaded devices, whose frame slips, before the periodic orbit.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

import mems_impact as mi
from mems_impact.analysis.settling import SETTLING_RTOL
from mems_impact.systems.settling import FLUCTUATING
from validation.campaign.comparing import ONE, Unit, Verdict

SLACK = 2.0  # errors within which the truth must lie
NOISE = 1e-5  # of a mean rate, relative to its largest part
LENGTHS = (24, 60, 150, 400)  # forcing periods
STEADY = 7  # one run in so many is continued to its steady state
LONG = (5_000, 2_500, 1_250, 625)  # periods of the run that gives the truth
DRIFT = "drift"


def _linear_flow(mode: Any, t: Any, y: Any, p: Any) -> Any:
    force = math.cos(p.omega * t)
    return (
        -p.l0 * (y.x0 - p.b0 - force),
        -p.l1 * (y.x1 - p.b1 - force),
        -p.a * y.c - p.nu * y.s + force,
        -p.a * y.s + p.nu * y.c,
        p.k0 * y.x0 + p.k1 * y.x1 * y.x1 + p.k2 * (y.c * y.c + y.s * y.s),
    )


def _duffing_flow(mode: Any, t: Any, y: Any, p: Any) -> Any:
    force = p.f * math.cos(p.omega * t)
    return y.v, y.x - y.x * y.x * y.x - p.d * y.v + force, y.x * y.x


def _period(p: Any) -> Any:
    return 2.0 * math.pi / p.omega


def _total(y: Any, p: Any) -> Any:
    return y.w


@cache
def _linear() -> mi.System:
    return mi.System(
        states=("x0", "x1", "c", "s", "w"),
        flow=_linear_flow,
        parameters=dict.fromkeys(
            ("l0", "l1", "a", "nu", "b0", "b1", "k0", "k1", "k2", "omega"), 1.0
        ),
        period=_period,
        observables=[mi.Observable(DRIFT, _total)],
        cyclic=["w"],
    )


@cache
def _duffing() -> mi.System:
    return mi.System(
        states=("x", "v", "w"),
        flow=_duffing_flow,
        parameters={"d": 0.3, "f": 0.5, "omega": 1.2},
        period=_period,
        observables=[mi.Observable(DRIFT, _total)],
        cyclic=["w"],
        initial={"x": 1.0},
    )


def _linear_case(rng: np.random.Generator) -> tuple[mi.System, dict[str, float], float, float]:
    """Return a system, its initial state, the mean gain per period, and its largest part."""
    omega = 10.0 ** rng.uniform(-2.0, 2.0)
    period = 2.0 * math.pi / omega
    q0, q1, r = 1.0 - 10.0 ** rng.uniform(-3.0, -0.1, 3)
    undamped = rng.random() < 0.25
    a = 0.0 if undamped else -math.log(r) / period
    angle = rng.choice([math.pi, 2.0 * math.pi / 3.0, rng.uniform(0.05, 6.2)])
    nu = angle / period
    l0, l1 = -math.log(q0) / period, -math.log(q1) / period
    b0, b1 = rng.choice([0.0, 1.0, -2.0], 2)
    k0, k1, k2 = rng.choice([0.0, 1.0, -0.3], 3)
    amplitude = 10.0 ** rng.uniform(-2.0, 0.7)
    start = dict(zip(("x0", "x1", "c", "s"), amplitude * rng.standard_normal(4), strict=True))
    forward, backward = 0.5 / (a + 1j * (omega - nu)), 0.5 / (a - 1j * (omega + nu))
    circle = abs(forward) ** 2 + abs(backward) ** 2
    if undamped:
        circle += abs(start["c"] + 1j * start["s"] - forward - backward) ** 2
    square = b1 * b1 + 0.5 * abs(l1 / (l1 + 1j * omega)) ** 2
    parts = np.array([k0 * b0, k1 * square, k2 * circle]) * period
    system = _linear().changed(
        l0=l0, l1=l1, a=a, nu=nu, b0=b0, b1=b1, k0=k0, k1=k1, k2=k2, omega=omega
    )
    scale = float(np.abs(parts).max()) + abs(k0) * period
    return system, start, float(parts.sum()), scale


def _long_mean(run: mi.Run) -> float | None:
    """Return the mean rate of Duffing's oscillator on the attractor that a run has reached."""
    for length in LONG:
        if length >= 2.0 * run.periods:
            long = mi.simulate(run.system, length, keep="statistics", options=run.options)
            if run.settling.kind != FLUCTUATING or long.settling.kind == FLUCTUATING:
                return float(long.statistics[DRIFT])
    return None


def _wrong(run: mi.Run, name: str, true: float, scale: float) -> str:
    """Return what a run tells wrongly about a statistic; empty if nothing."""
    row = run.settling.rows.get(name)
    if row is None:
        return ""
    bound = SLACK * SETTLING_RTOL * abs(true) + NOISE * scale
    settled = row.kind == "settled"
    apart = abs((row.value if settled else row.limit) - true)
    if apart <= (0.0 if settled else SLACK * row.error) + bound:
        return ""
    limit = f"limit {row.limit:.9g} ± {row.error:.3g}"
    return f"{name} = {row.value:.9g}, {row.kind}, {limit}, true {true:.9g}"


def check(seed: int, number: int, unit: Unit = ONE) -> Verdict:
    """Try one run, and its steady state."""
    rng = np.random.default_rng([seed, 46, number])
    verdict = Verdict("settling", number, 1)
    options = mi.Options(method="auto" if unit.method == Unit.method else unit.method)
    kind = number % 8
    length = int(rng.choice(LENGTHS))
    name = DRIFT
    if kind < 5:
        system, start, true, scale = _linear_case(rng)
        run = mi.simulate(system, length, initial=start, options=options)
    elif kind == 5:
        system = _duffing().changed(d=rng.uniform(0.05, 0.5), f=rng.uniform(0.1, 0.6))
        run = mi.simulate(system, length, options=options)
        true = _long_mean(run)
        if true is None:
            verdict.horizon = 0.0
            return verdict
        scale = true
    else:
        name = "mean speed"
        device, drive = _device(rng)
        start = mi.kicked_state(device)
        run = mi.simulate(device, drive, length, initial=start, options=options)
        try:
            orbit: Any = mi.find_orbit(device, drive, guess=start, transient=1000)
        except (mi.OrbitError, mi.RunError):
            orbit = None
        if orbit is None or not orbit.stable:
            verdict.horizon = 0.0
            return verdict
        true = float(orbit.step / (orbit.periods * orbit.period))
        scale = float(np.abs(orbit.samples(50)["v1"]).max())
        true, scale = (float(run.system.units.into(name, each)) for each in (true, scale))
    verdict.story = _wrong(run, name, true, scale)
    if not verdict.story and number % STEADY == 0:
        run = mi.steady_state(run)
        true = _long_mean(run) if kind == 5 else true
        story = "" if true is None else _wrong(run, name, true, scale)
        verdict.story = f"in the steady state {story}" if story else ""
    if verdict.story:
        verdict.story += f" ({length} periods)"
    return verdict


def _device(rng: np.random.Generator) -> tuple[mi.Actuator, mi.Sine]:
    """Return a device whose frame slips easily, in SI or dimensionless."""
    device = mi.load_actuator("zhao2004").replace(
        e=rng.uniform(0.3, 0.9),
        mu_s=(friction := 10.0 ** rng.uniform(-2.5, 0.0)),
        mu_d=friction * rng.uniform(0.5, 1.0),
        c=10.0 ** rng.uniform(-2.0, -0.5),
    )
    return device, mi.Sine(amplitude=rng.uniform(0.15, 0.4), omega=rng.uniform(0.4, 0.6))
