"""Pull-in: the static threshold, the travel range, and a slow ramp across it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

import mems_impact as mi
from validation.campaign.result import Result

DEVICE = mi.load_actuator("zhao2004").replace(c=3.0, delta=0.9)
THRESHOLD = math.sqrt(4.0 / 27.0)


def settles(voltage: float) -> float:
    """Where the block is after a long time under a constant voltage."""
    run = mi.simulate(
        DEVICE,
        mi.Sine(amplitude=0.0, omega=0.5, bias=voltage),
        60,
        options=mi.Options(method="bdf", rtol=1e-10, atol=1e-12),
    )
    return float(run.final.x2)


def static(seed: int, small: bool) -> Result:
    """Below the threshold the block stands where the forces balance, above it is pulled in."""
    findings = []
    shares = (0.3, 0.6, 0.9, 0.97)
    worst = 0.0
    for share in shares:
        v = share * THRESHOLD
        exact = brentq(lambda x, v=v: x * (1.0 - x) ** 2 - v * v, 0.0, 1.0 / 3.0, xtol=1e-15)
        worst = max(worst, abs(settles(v) - exact))
    low, high = 0.9 * THRESHOLD, 1.1 * THRESHOLD
    for _ in range(8 if small else 14):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if settles(middle) > 0.5 else (middle, high)
    # A run of finite length ends before a voltage just above the threshold has pulled in.
    error = 0.5 * (low + high) / THRESHOLD - 1.0
    if worst > 1e-8:
        findings.append(f"travel off by {worst:.1e}")
    if not -1e-4 <= error <= 5e-3:
        findings.append(f"threshold off by {error:.1e}")
    figures = f"travel up to 0.97 of the threshold {worst:.1e}, threshold {error:+.1e}"
    return Result("pull-in, static", len(shares) + 14, figures, findings)


def crossing(omega: float) -> float:
    """The voltage at which a slow sine with bias pulls the block beyond half of the gap."""
    drive = mi.Sine(amplitude=0.1, omega=omega, bias=0.38, phase=-math.pi)
    settings = mi.Options(method="bdf", rtol=1e-9, atol=1e-11)
    run = mi.simulate(DEVICE, drive, 0.5, options=settings)
    hit = run.trajectory.events
    t = float(hit.time[(hit.guard == 0) & (hit.kind == 0)][0])
    return 0.38 + 0.1 * math.cos(omega * t - math.pi)


def ramp(seed: int, small: bool) -> Result:
    """A ramp passes the fold late by the power 2/3 of its rate; in the limit at the threshold."""
    rates = np.array([1e-3, 1e-4, 1e-5] if small else [1e-3, 1e-4, 1e-5, 1e-6])
    late = np.array([crossing(rate) for rate in rates]) / THRESHOLD - 1.0
    powers = np.diff(np.log(late)) / np.diff(np.log(rates))
    limit = late[-1] - (late[-2] - late[-1]) / ((rates[-2] / rates[-1]) ** (2.0 / 3.0) - 1.0)
    findings = []
    if np.any(late <= 0.0) or abs(powers[-1] - 2.0 / 3.0) > 0.08:
        findings.append(f"late by {late}, powers {powers}")
    if abs(limit) > 2e-4:
        findings.append(f"in the limit the ramp crosses {limit:+.1e} beside the threshold")
    figures = (
        f"late by {late[0]:.1e} to {late[-1]:.1e}, power {powers[-1]:.3f} (2/3), limit {limit:+.0e}"
    )
    return Result("pull-in, slow ramp", len(rates), figures, findings)


ATTACKS: list[Callable[..., Result]] = [static, ramp]
