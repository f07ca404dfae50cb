"""The boundaries of Fig. 7: where continuation has an orbit end, simulation switches on and off."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

import mems_impact as mi
from mems_impact.actuator.design.thresholds import locate_crisis
from validation.campaign.result import Result

DEVICE = mi.load_actuator("zhao2004")
FAST = mi.Options(method="dop853")


def continued(omega: float) -> tuple[float, float]:
    """Return where the device switches on and off; NaN for a crisis, which is no orbit's end."""
    orbit = mi.find_orbit(DEVICE, mi.Sine(amplitude=0.05, omega=omega))
    branch = mi.continue_solution(orbit, "amplitude", 0.36)
    first = branch.special_points[0]
    if first.label == "CF":
        return first.value, math.nan
    if first.type == mi.GrazingType.CONTINUOUS:
        return first.value, first.value
    return first.value, next(s.value for s in branch.special_points if s.label == "CF")


def switched_on(omega: float, near: float, tolerance: float) -> float:
    """Return the least amplitude at which a slow rise begins to impact, by bisection."""

    def hits(amplitude: float, periods: int, start: mi.State) -> tuple[bool, mi.State]:
        drive = mi.Sine(amplitude=amplitude, omega=omega)
        run = mi.simulate(
            DEVICE, drive, periods, initial=start, window=(0, periods), keep="statistics",
            options=FAST,
        )  # fmt: skip
        return run.statistics["impacts"] > 0.0, run.final

    low, high = 0.9951 * near, 1.005 * near
    state = mi.State()
    # Slowly from far below: a start from rest may overshoot and switch on early.
    for amplitude in np.linspace(0.3 * near, low, 60).tolist():
        _, state = hits(amplitude, 100, state)
    while high - low > tolerance:
        middle, here, hit = 0.5 * (low + high), state, False
        for amplitude in np.linspace(low, middle, 12)[1:].tolist():
            struck, here = hits(amplitude, 250, here)
            hit = hit or struck
        # Where an orbit has just vanished in a fold, a run lingers for long.
        struck, here = hits(middle, 4000, here)
        if hit or struck:
            high = middle
        else:
            low, state = middle, here
    return high


def boundaries(seed: int, small: bool) -> Result:
    """Switching on at frequencies of all three types, and off where type I ends in a fold."""
    omegas = np.linspace(0.443, 0.509, 12)[[6, 7] if small else slice(None)].tolist()
    tolerance = 1e-6 if small else 2e-7
    ons, offs, findings = [], [], []
    for omega in omegas:
        on, off = continued(omega)
        ons.append(abs(switched_on(omega, on, tolerance) - on))
        if off < on and not small:
            # From above: near the fold a run lingers where the orbit has vanished.
            seen = locate_crisis(
                DEVICE, mi.Sine(amplitude=on, omega=omega), amplitude=1.002 * off, begin=1.01 * on,
                width=0.05, tolerance=5e-7, periods=5000, options=FAST,
            )  # fmt: skip
            offs.append(abs(seen - off))
        # The bisection ends up to its tolerance above; beside a fold a run outlasts any wait.
        if ons[-1] > 3.0 * tolerance or (offs and offs[-1] > 5e-7):
            findings.append(f"omega {omega:.3f}: on off by {ons[-1]:.1e}, off by {offs[-1:]}")
    figures = f"on {max(ons):.1e} apart" + (f", off {max(offs):.1e}" if offs else "")
    return Result("boundaries of Fig. 7 by simulation", len(ons) + len(offs), figures, findings)


ATTACKS: list[Callable[..., Result]] = [boundaries]
