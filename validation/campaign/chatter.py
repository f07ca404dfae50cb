"""Sequences of impacts: where they end and what follows, against closed forms."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

import mems_impact as mi
from mems_impact.hybrid import loop
from mems_impact.hybrid.run import run
from tests.hybrid import systems
from validation.campaign import judge as judges
from validation.campaign.cases import Case
from validation.campaign.checks import verdict
from validation.campaign.result import Result
from validation.campaign.scans import TIGHT, judged, steady, zhao


def _end(trajectory: object) -> float:
    found = systems.times(trajectory, loop.ACCUMULATION)
    return float(found[0]) if len(found) else math.nan


def accumulation(seed: int, small: bool) -> Result:
    """A bouncing ball, and a spring that presses on a stop: the end of the sequence."""
    ball = spring = half = 0.0
    findings, tried = [], 0
    for e in np.linspace(0.05, 0.95, 5 if small else 46).tolist():
        tried += 2
        options = {"rtol": 1e-13, "atol": 1e-15}
        fall = systems.simulate(systems.BALL, systems.ball(e), [1.0, 0.0], 20.0, **options)
        exact = math.sqrt(2.0) * (1.0 + e) / (1.0 - e)
        ball = max(ball, abs(_end(fall) - exact) / exact)
        if fall.final.mode != systems.RESTING or np.any(fall.final.y != 0.0):
            findings.append(f"ball, e = {e:.2f}: rests at {fall.final.y}")
        p = systems.stop(e=e, d=-1.0)
        press = systems.simulate(systems.STOP, p, [-1.5, 0.0], 20.0, **options)
        # From -1.5 at rest: the stop at -1 is reached when cos t = 1/1.5.
        u = 1.5 * math.sin(math.acos(1.0 / 1.5))
        exact = math.acos(1.0 / 1.5)
        exact += math.fsum(2.0 * math.atan(u * e**n) for n in range(1, 3000))
        # Position counts from the middle of the spring: its error of rtol changes the speed of an
        # impact u by rtol/u, u down to 1e-5 in the last flights, and the end by 2/(1 - e) as much.
        allowed = 1e-13 / 2e-5 / (1.0 - e)
        spring = max(spring, abs(_end(press) - exact) / allowed)
        if abs(e - 0.5) < 0.02:
            half = max(half, abs(_end(press) - exact))
        if press.final.mode != systems.RESTING or press.final.y.tolist() != [-1.0, 0.0]:
            findings.append(f"spring, e = {e:.2f}: rests at {press.final.y}")
    if ball > 1e-10 or spring > 3.0:
        findings.append(f"the end is off by {ball:.1e}, {spring:.1e} of what it may be")
    figures = f"end of the sequence: ball {ball:.1e} (relative), spring {half:.1e} at e = 1/2, "
    figures += f"{spring:.2f} of what the tolerance allows"
    return Result("chatter, closed form", tried, figures, findings)


def on_the_actuator(seed: int, small: bool) -> Result:
    """The actuator pressed by a constant voltage: the judge follows every impact to 2e-7."""
    worst = step = 0.0
    findings, tried = [], 0
    for e in (0.0, 0.2, 0.5, 0.8, 0.9):
        for level in (0.4, 0.5, 0.8):
            for mu in (0.27, 0.02):
                tried += 1
                device = zhao(e=e, mu_s=mu, mu_d=mu)
                case = Case("", device, steady(level, 100.0), (0, 0, 0.45, 0.2), 0.0, 1.0, TIGHT)
                done = case.run(rtol=1e-13, atol=1e-15).trajectory
                truth = verdict(case, 100.0, np.array([]))
                step = max(step, abs(done.final.y[0] - truth.final[0]))
                ends = [row.t for row in truth.rows if row.kind == judges.REST]
                mine = systems.times(done, loop.ACCUMULATION)
                if len(ends) != len(mine):
                    findings.append(f"e {e} v {level} mu {mu}: {len(mine)} ends, not {len(ends)}")
                elif ends:
                    worst = max(worst, abs(ends[0] - mine[0]))
    if worst > 1e-8 or step > 1e-10:
        findings.append(f"end off by {worst:.1e}, frame by {step:.1e}")
    figures = f"end of the sequence {worst:.1e}, place of the frame {step:.1e}"
    return Result("chatter of the actuator, judge", tried, figures, findings)


def pressed_for_long(seed: int, small: bool) -> Result:
    """A slow drive that presses the block to the stopper for most of a cycle, 1,000 cycles."""
    cycles = 100 if small else 1000
    findings = []
    drive = mi.Square(amplitude=0.5, omega=0.1, duty=0.8)
    device = mi.load_actuator("zhao2004")
    problem = mi.studies.run.problem_of(device, drive, mi.Options(engine="compiled"))
    state = mi.studies.simulate.instant_of_state(device, drive, mi.State())
    run(problem, state, 2.0)  # compiled and warm
    times, events, steps = [], [], []
    for _ in range(10):
        began = time.perf_counter()
        done = run(problem, state, cycles / 10.0)
        times.append(time.perf_counter() - began)
        events.append(int((done.events.kind == loop.ACCUMULATION).sum()))
        steps.append(done.steps)
        state = done.final
    whole = mi.simulate(device, drive, cycles)
    apart = abs(whole.final.x1 - state.y[0])
    resting = float(whole.measured.share_resting)
    if max(steps[1:]) > 1.02 * min(steps[1:]):
        findings.append(f"steps a tenth of the run: {steps}")
    if len(set(events[1:])) > 1:
        findings.append(f"rests a tenth of the run: {events}")
    if resting < 0.6:
        findings.append(f"rests {resting:.2f} of the time only")
    if apart > 1e-9 * max(1.0, abs(state.y[0])):
        findings.append(f"in ten parts the frame ends {apart:.1e} away")
    case = Case("", zhao(), judged_spec(), (0, 0, 0, 0), 0.0, 10.0, TIGHT)
    findings += judged("", [case], least=0.9).findings
    ratio = max(times[-3:]) / min(times[:3])
    figures = (
        f"{cycles} cycles, rests {resting:.2f} of the time, {sum(times) / cycles * 1e3:.2f} ms "
    )
    figures += f"a cycle, last tenths over first {ratio:.2f}, in ten parts {apart:.0e} apart"
    return Result("pressed for most of a cycle", cycles, figures, findings)


def judged_spec() -> object:
    from validation.campaign.drives import Spec

    return Spec("square", {"amplitude": 0.5, "omega": 0.1, "duty": 0.8})


ATTACKS: list[Callable[..., Result]] = [accumulation, on_the_actuator, pressed_for_long]
