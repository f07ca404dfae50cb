"""Sequences of impacts of the actuator: where they end and what follows.

Those whose end is known in closed form are tests (`tests/hybrid/test_sequences.py`).
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

import mems_impact as mi
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import run
from validation.campaign.cases import Case
from validation.campaign.checks import verdict
from validation.campaign.result import Result
from validation.campaign.scans import TIGHT, judged, steady, zhao
from validation.judges import heyoka_full


def on_the_actuator(seed: int, small: bool) -> Result:
    """The actuator pressed by a constant voltage: the judge follows every impact to 2e-7."""
    worst = step = 0.0
    findings, tried = [], 0
    # The frame stays, slips at every impact, or slides on through all of them.
    for e in (0.0, 0.2, 0.5, 0.8, 0.9):
        for level in (0.4, 0.5, 0.8):
            for mu, v1 in ((0.27, 0.0), (0.02, 0.0), (0.02, 1.0)):
                tried += 1
                device = zhao(e=e, mu_s=mu, mu_d=mu)
                case = Case("", device, steady(level, 100.0), (0, v1, 0.45, 0.2), 0.0, 1.0, TIGHT)
                done = case.run(rtol=1e-13, atol=1e-15).trajectory
                truth = verdict(case, 100.0, np.array([]))
                step = max(step, abs(done.final.y[0] - truth.final[0]))
                ends = [row.t for row in truth.rows if row.kind == heyoka_full.REST]
                rests = done.events[done.events.kind == workspace.ACCUMULATION]
                mine = rests.cycle * done.period + rests.time
                if len(ends) != len(mine):
                    findings.append(f"e {e} v {level} mu {mu}: {len(mine)} ends, not {len(ends)}")
                elif ends:
                    worst = max(worst, abs(ends[0] - mine[0]))
    if worst > 1e-8 or step > 3e-11:
        findings.append(f"end off by {worst:.1e}, frame by {step:.1e}")
    figures = f"end of the sequence {worst:.1e}, place of the frame {step:.1e}"
    return Result("chatter of the actuator, judge", tried, figures, findings)


def pressed_for_long(seed: int, small: bool) -> Result:
    """A slow drive that presses the block to the stopper for most of a cycle, 1,000 cycles."""
    cycles = 100 if small else 1000
    findings = []
    drive = mi.Square(amplitude=0.5, omega=0.1, duty=0.8)
    device = mi.load_actuator("zhao2004")
    system = device.under(drive)
    problem = system.problem(mi.Options(engine="compiled"))
    state = system.state_space.instant(None, problem)
    run(problem, state, 2.0)  # compiled and warm
    times, events, steps = [], [], []
    for _ in range(10):
        began = time.perf_counter()
        done = run(problem, state, cycles / 10.0)
        times.append(time.perf_counter() - began)
        events.append(int((done.events.kind == workspace.ACCUMULATION).sum()))
        steps.append(done.steps)
        state = done.final
    whole = mi.simulate(device, drive, cycles)
    apart = abs(whole.final.x1 - state.y[0])
    resting = float(whole.measured["share resting"])
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


ATTACKS: list[Callable[..., Result]] = [on_the_actuator, pressed_for_long]
