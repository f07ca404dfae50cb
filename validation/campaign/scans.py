"""Aimed scans: what random runs hit too seldom."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

import mems_impact as mi
from mems_impact.hybrid.event_loop import workspace
from validation.campaign.cases import Case, hold_voltage
from validation.campaign.checks import SHORT, Outcome, check, verdict
from validation.campaign.drives import Spec
from validation.campaign.result import Result
from validation.judges import heyoka_full

TIGHT = {"rtol": 1e-11, "atol": 1e-13, "method": "adams", "engine": "compiled"}
NEAR = [0.0, *(sign * 10.0**-k for k in (16, 15, 14, 13, 12, 10, 8, 6, 4) for sign in (1, -1))]


def zhao(**changes: float) -> dict[str, float]:
    device = mi.load_actuator("zhao2004").replace(**changes)
    return {name: float(value) for name, value in device if name != "units"}


def steady(level: float, length: float = 50.0) -> Spec:
    return steps(length, (0.0, level))


def steps(length: float, *knots: tuple[float, ...]) -> Spec:
    """A ladder of (start, level) or (start, level, slope)."""
    rows = [(*knot, 0.0)[:3] for knot in knots]
    starts, levels, slopes = zip(*rows, strict=True)
    fields = {"length": length, "starts": starts, "levels": levels, "slopes": slopes}
    return Spec("ladder", fields)


def judged(name: str, cases: Iterable[Case], least: float = 0.0) -> Result:
    """Put cases before the judge; `least`: the share of the runs on which it must have spoken."""
    outcomes: list[Outcome] = [
        check(case, interpreted=SHORT if i % 29 == 0 else 0) for i, case in enumerate(cases)
    ]
    findings = [f"{o.name}: {'; '.join(o.findings)}" for o in outcomes if o.findings]
    horizon = float(np.mean([o.horizon for o in outcomes]))
    if horizon < least:
        findings.append(f"the judge spoke on {horizon:.2f} of the runs only")
    matched = sum(o.matched for o in outcomes)
    ended = sum(o.status == "result" for o in outcomes)
    findings += [f"{o.name}: {o.status}" for o in outcomes if o.status != "result"]
    figures = f"{matched} events matched, {ended} results, horizon {horizon:.2f}"
    return Result(name, len(outcomes), figures, findings)


def grazes(seed: int, small: bool) -> Result:
    """The block swings freely; the stopper is put below the crest that it reaches."""
    phases = np.linspace(0.3, 3.05, 20 if small else 500)
    depths = [10.0**-k for k in range(2, 13)]
    still = Spec("sine", {"amplitude": 0.0, "omega": 0.5})
    options = {**TIGHT, "rtol": 1e-8, "atol": 1e-10}
    missed = doubled = 0
    deepest = worst = 0.0
    for phase in phases:
        start = (0.0, 0.0, 0.4 * math.cos(phase), 0.4 * math.sin(phase))
        free = Case("graze", zhao(c=0.0), still, start, 0.0, 0.6, options)
        log = free.run().trajectory.events
        crest = float(log.before[log.kind == workspace.APPROACH][0, 2])
        for depth in depths:
            # Only if the start is below the stopper is there a graze.
            if abs(start[2]) >= crest - depth:
                continue
            lower = replace(free, device=zhao(c=0.0, delta=crest - depth))
            log = lower.run().trajectory.events
            hits = log[(log.kind == workspace.TRANSITION) & (log.guard == 0)]
            missed += len(hits) == 0
            doubled += len(hits) > 1
            deepest = max(deepest, float(log.before[:, 2].max(initial=0.0)) - crest + depth)
            if len(hits):
                expected = phase - math.acos(min(1.0, (crest - depth) / crest))
                # The crest is flat: its time is uncertain by the error of v2 over the depth.
                error = abs(hits.time[0] - expected) * math.sqrt(depth)
                worst = max(worst, error)
    tried = len(phases) * len(depths)
    findings = [f"{missed} missed, {doubled} doubled"] if missed or doubled else []
    if deepest > 1e-9 * 0.4:
        findings.append(f"penetration {deepest:.1e}")
    if worst > 1e-6:
        findings.append(f"times off by {worst:.1e}/sqrt(depth)")
    figures = f"missed {missed}, doubled {doubled}, deepest {deepest:.1e}, "
    return Result(
        "grazes 1e-2 to 1e-12", tried, figures + f"time error {worst:.1e}/sqrt(depth)", findings
    )


def impact_at_slip_end(seed: int, small: bool) -> Result:
    """The frame's slip ends in the instant in which the block strikes."""
    device, drive = zhao(), steady(0.2)

    def start(v1: float) -> tuple[float, float, float, float]:
        return (0.0, v1, 0.3, 0.6)

    def lag(v1: float) -> float:
        case = Case("", device, drive, start(v1), 0.0, 1.0, TIGHT)
        rows = verdict(case, 5.0, np.array([])).rows
        first = {row.kind: row.t for row in reversed(rows)}
        return first[heyoka_full.SLIP_END] - first[heyoka_full.RIGHT]

    # Up to the impact of the first slip the two times depend smoothly on v1.
    exact = brentq(lag, 0.2, 3.0, xtol=1e-15) if lag(0.2) * lag(3.0) < 0.0 else 1.0
    cases = [
        Case(f"v1 {shift:+.0e}", device, drive, start(exact + shift), 0.0, 0.2, TIGHT)
        for shift in NEAR
    ]
    return judged("impact and slip end in one instant", cases)


def switch_at_impact(seed: int, small: bool) -> Result:
    """The voltage jumps in the instant in which the block strikes."""
    device, start = zhao(), (0.0, 0.0, 0.1, 0.7)
    cases = []
    for level, after in ((0.2, 0.6), (0.2, 0.0), (0.5, 0.1), (0.3, -0.3)):
        case = Case("", device, steady(level), start, 0.0, 0.2, TIGHT)
        t = verdict(case, 5.0, np.array([])).rows[0].t
        for shift in NEAR:
            drive = steps(20.0, (0.0, level), (t + shift, after))
            cases.append(Case(f"{level} {shift:+.0e}", device, drive, start, 0.0, 1.5, TIGHT))
            # The same with the impact where one period ends and the next begins.
            drive = steps(t + shift, (0.0, level))
            cases.append(Case(f"{level} end {shift:+.0e}", device, drive, start, 0.0, 6.0, TIGHT))
    return judged("drive switches at an impact", cases)


def while_sliding(seed: int, small: bool) -> Result:
    """Impacts and sequences of impacts while the frame slips, from little friction to none."""
    cases = []
    for mu in (0.0, 1e-3, 0.03) if small else (0.0, 1e-4, 1e-3, 3e-3, 1e-2, 0.03):
        for level in (0.2, 0.4, 0.8):
            for v1 in (-0.5, 0.0, 0.5):
                device = zhao(mu_s=mu, mu_d=0.7 * mu)
                start = (0.0, v1, 0.2, 0.9)
                name = f"mu {mu} v {level} v1 {v1}"
                cases.append(Case(name, device, steady(level), start, 0.0, 1.0, TIGHT))
                wave = Spec("sine", {"amplitude": level, "omega": 0.3})
                cases.append(Case(name + " sine", device, wave, start, 0.0, 5.0, TIGHT))
    return judged("impacts and chatter while sliding", cases)


def release_in_slip(seed: int, small: bool) -> Result:
    """A resting block is let go while the frame slips, and at the end of the slip."""
    cases = []
    for mu in (0.001, 0.01, 0.05):
        for v1 in (-0.4, 0.4):
            device = zhao(mu_s=mu, mu_d=mu)
            hold = hold_voltage(device)
            slip = abs(v1) / (mu * device["g"])
            for share in (0.1, 0.5, 0.9, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 1.3):
                t = share * slip
                jump = steps(slip + t + 20.0, (0.0, 1.5 * hold), (t, 0.5 * hold))
                ramp = steps(3.0 * t, (0.0, 1.5 * hold, -hold / (2.0 * t)))
                for drive in (jump, ramp):
                    name = f"mu {mu} v1 {v1} at {share}"
                    start = (0.0, v1, device["delta"], 0.0)
                    length = min(1.0, 60.0 / drive.fields["length"])
                    cases.append(Case(name, device, drive, start, 0.0, length, TIGHT))
    return judged("release during a slip", cases)


def static_limit(seed: int, small: bool) -> Result:
    """The greatest load on the stuck frame is the static limit, to 1e-16 and with the signs."""
    cases = []
    still = Spec("sine", {"amplitude": 0.0, "omega": 0.5})
    for phase in (0.0, 0.7, 2.0):
        for shift in NEAR:
            base = zhao(c=0.0)
            mu = 0.4 * (1.0 + shift) / ((base["m1"] + base["m2"]) * base["g"])
            device = {**base, "mu_s": mu, "mu_d": 0.6 * mu}
            start = (0.0, 0.0, 0.4 * math.cos(phase), 0.4 * math.sin(phase))
            cases.append(Case(f"{phase} {shift:+.0e}", device, still, start, 0.0, 4.0, TIGHT))
    return judged("break-away at the static limit", cases)


def restitution(seed: int, small: bool) -> Result:
    """Restitution from 0 to 1, walking and pressed."""
    cases = []
    for e in np.linspace(0.0, 1.0, 11 if small else 101).tolist():
        for amplitude, omega, periods in ((0.24, 0.5, 20.0), (0.45, 0.1, 3.0)):
            wave = Spec("sine", {"amplitude": amplitude, "omega": omega})
            start = (0.0, 0.0, 0.0, 0.5)
            cases.append(Case(f"e {e:.2f}", zhao(e=e), wave, start, 0.0, periods, TIGHT))
    return judged("restitution 0 to 1", cases)


def equal_friction(seed: int, small: bool) -> Result:
    """Static and dynamic friction are equal."""
    cases = []
    for mu in np.geomspace(1e-4, 1.0, 9 if small else 60).tolist():
        for bias in (0.0, 0.2):
            wave = Spec("sine", {"amplitude": 0.3, "omega": 0.5, "bias": bias})
            device = zhao(mu_s=mu, mu_d=mu)
            case = Case(f"mu {mu:.3g}", device, wave, (0.0, 0.2, 0.1, 0.5), 0.0, 12.0, TIGHT)
            cases.append(case)
    return judged("mu_d = mu_s", cases)


def start_on_guard(seed: int, small: bool) -> Result:
    """Every combination of guards that a start can stand on."""
    cases = []
    device = zhao()
    limit = device["mu_s"] * 6.0 * device["g"]
    weak = zhao(mu_s=0.4 / (6.0 * device["g"]), mu_d=0.2 / (6.0 * device["g"]))
    hold = hold_voltage(device)
    speeds = (0.0, 1e-300, -1e-300, 1e-13, -1e-13, 0.5, -0.5)
    for p in (device, weak):
        for x2 in (0.5, -0.5, 0.4, np.nextafter(0.5, 0.0)):
            for v2 in speeds:
                for v1 in (0.0, 1e-300, -1e-13, 0.5):
                    for level in (0.0, hold) if small else (0.0, 0.5 * hold, hold, 1.5 * hold):
                        name = f"{x2} {v2} {v1} {level:.3g} {limit:.3g}"
                        start = (0.0, v1, float(x2), v2)
                        cases.append(Case(name, p, steady(level), start, 0.0, 0.3, TIGHT))
    return judged("start on a guard", cases[:: 16 if small else 1])


def many_cycles_while_resting(seed: int, small: bool) -> Result:
    """Load and contact force vary many times within a period while nothing moves."""
    cases = []
    hold = hold_voltage(zhao())
    for times in (7, 16, 31, 59):
        for beyond in (1e-2, 1e-4, 1e-6):
            # Of many dips of the contact force within a period one or two go below zero.
            fields = {"bias": 1.3 * hold, "a1": 0.1 * hold, "a2": (0.2 + beyond) * hold}
            wave = Spec("custom", {**fields, "omega": 0.05, "times": times, "phase": 0.3})
            start = (0.0, 0.0, 0.5, 0.0)
            cases.append(Case(f"rest {times} {beyond}", zhao(), wave, start, 0.0, 2.0, TIGHT))
            # The same with the load of a heavily damped block and a weakly held frame.
            fields = {"bias": 0.12, "a1": 0.02, "a2": 0.05, "omega": 0.05, "times": times}
            device = zhao(c=3.0, mu_s=0.0004 + beyond, mu_d=0.0003)
            wave = Spec("custom", {**fields, "phase": 0.3})
            start = (0.0, 0.0, 0.0, 0.0)
            cases.append(Case(f"stuck {times} {beyond}", device, wave, start, 0.0, 2.0, TIGHT))
    return judged("many cycles of the load in a period", cases)


ATTACKS: list[Callable[..., Result]] = [
    grazes,
    impact_at_slip_end,
    switch_at_impact,
    while_sliding,
    release_in_slip,
    static_limit,
    restitution,
    equal_friction,
    start_on_guard,
    many_cycles_while_resting,
]


def run_all(small: bool = True, **_: Any) -> list[Result]:
    return [attack(seed=1, small=small) for attack in ATTACKS]
