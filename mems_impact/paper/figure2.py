"""Fig. 2: the automaton as a diagram, drawn from the code's own transitions.

Nothing here knows the rules. Every mode is put into very many states in which it may be, under
several voltages and devices; every guard that watches it is let fire on its boundary; where the
transition leads is what the diagram shows.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.actuator.automaton import (
    GUARDS,
    MODES,
    RELEASE,
    RIGHT_IMPACT,
    SLIP_END,
    STATES,
    V1,
    V2,
    X2,
    actuator_automaton,
    direction_of,
    side_of,
)
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.impacts import is_impact
from mems_impact.actuator.parameters import Actuator
from mems_impact.analysis.simulate import simulate
from mems_impact.hybrid.automaton import Automaton
from mems_impact.paper import tables
from mems_impact.paper.automaton import plot_automaton
from mems_impact.paper.outcome import Devices, Effort, Outcome

__all__ = ["compute", "transitions"]

BISECTIONS = 60
Step = tuple[int, int, int]  # mode, code, mode


def compute(devices: Devices, effort: Effort) -> Outcome:
    """Return the diagram, and what the paper says of impact and phases."""
    found = transitions(devices.paper, effort.of(40_000, 6_000))
    steps = set(found)
    free = {mode for mode in range(len(MODES)) if side_of(mode) == 0}
    stuck, sliding = MODES.index("stuck-free"), MODES.index("forward-free")
    momentum, restitution = _impact_errors(devices.paper)
    log = tables.transitions(
        [(MODES[a], _name(code), MODES[b], count) for (a, code, b), count in sorted(found.items())]
    )
    reached = {b for _, _, b in steps} & free
    return Outcome(
        values={
            "2.phases": {stuck, sliding} <= reached,
            "2.impact-moves": (stuck, RIGHT_IMPACT, sliding) in steps,
            "2.slip-ends": (sliding, SLIP_END, stuck) in steps,
            "2.momentum": momentum,
            "2.restitution": restitution,
        },
        tables={"transitions": log},
        draw=lambda: plot_automaton(log).figure,
        notes=(
            f"{len(steps)} transitions between {len(MODES)} modes were found by letting guards "
            "fire in random states. The flow chart of the paper has the middle column alone: it "
            "leaves out rest on a stopper.",
        ),
    )


def transitions(actuator: Actuator, samples: int) -> Counter[Step]:
    """Return how often each (mode, code, mode) was seen.

    Parameters
    ----------
    actuator : Actuator
        Dimensionless; a second one with weak friction is tried beside it, since this frame never
        breaks away under the voltages of the paper.
    samples : int
        Random states tried for every device.
    """
    automaton = actuator_automaton(Sine.voltage, Sine.voltage_rate)
    weak = actuator.replace(mu_s=actuator.mu_s / 200.0, mu_d=actuator.mu_d / 200.0)
    generator = np.random.default_rng(0)
    seen: Counter[Step] = Counter()
    for device in (actuator, weak):
        for _ in range(samples):
            seen.update(_trial(automaton, device, generator))
    return seen


def _trial(
    automaton: Automaton, device: Actuator, generator: np.random.Generator
) -> Iterator[Step]:
    """Put one mode into a random state on one of its guards and let that fire."""
    m = len(GUARDS)
    q = Sine(amplitude=float(generator.uniform(0.05, 1.6) ** 2), omega=1.0).parameters()
    p = np.concatenate([device.to_array(), q])
    t = float(generator.uniform(0.0, np.pi))
    mode, guard = int(generator.integers(len(MODES))), int(generator.integers(m))

    def margin(y: Floats) -> tuple[float, float]:
        g, r = np.empty(m), np.empty(m)
        automaton.margins(mode, t, y, p, g, r)
        return float(g[guard]), float(r[guard])

    inside, outside = _random(mode, device, generator), _random(mode, device, generator)
    if guard == RELEASE and side_of(mode) != 0:
        # The contact force hangs on time alone.
        yield from _by_time(automaton, mode, guard, inside, p)
        return
    if not margin(inside)[0] > 0.0 > margin(outside)[0]:
        return
    for _ in range(BISECTIONS):
        middle = 0.5 * (inside + outside)
        inside, outside = (middle, outside) if margin(middle)[0] > 0.0 else (inside, middle)
    if margin(outside)[1] >= 0.0 or not _in_mode(automaton, mode, guard, t, outside, p):
        return  # no flow of this mode leads here
    y = outside.copy()
    yield mode, guard, int(automaton.transition(mode, guard, t, y, p))
    if GUARDS[guard].impact:
        # A sequence of impacts accumulates where the block is pressed on the stopper.
        y, slope = outside.copy(), np.empty(len(STATES))
        side = 1.0 if guard == RIGHT_IMPACT else -1.0
        y[V2] = 1e-9 * side
        automaton.flow(mode, t, y, p, slope)
        if side * slope[V2] > 0.0 and _in_mode(automaton, mode, guard, t, y, p):
            yield mode, m + guard, int(automaton.transition(mode, m + guard, t, y, p))


def _by_time(automaton: Automaton, mode: int, guard: int, y: Floats, p: Floats) -> Iterator[Step]:
    """Let time go until the guard fires, the state held."""
    m = len(GUARDS)
    g, r = np.empty(m), np.empty(m)

    def margin(t: float) -> float:
        automaton.margins(mode, t, y, p, g, r)
        return float(g[guard])

    grid = np.linspace(0.0, np.pi, 40)
    values = np.array([margin(float(t)) for t in grid])
    falls = np.flatnonzero((values[:-1] > 0.0) & (values[1:] < 0.0))
    if falls.size == 0 or not _in_mode(automaton, mode, guard, float(grid[falls[0]]), y, p):
        return
    low, high = float(grid[falls[0]]), float(grid[falls[0] + 1])
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if margin(middle) > 0.0 else (low, middle)
    after = y.copy()
    yield mode, guard, int(automaton.transition(mode, guard, high, after, p))


def _in_mode(automaton: Automaton, mode: int, guard: int, t: float, y: Floats, p: Floats) -> bool:
    """Return whether the automaton may be in `mode` here: no other margin is violated."""
    m = len(GUARDS)
    g, r = np.empty(m), np.empty(m)
    automaton.margins(mode, t, y, p, g, r)
    g[guard] = 0.0
    return bool((g >= 0.0).all())


def _random(mode: int, device: Actuator, generator: np.random.Generator) -> Floats:
    y = generator.uniform(-1.0, 1.0, 4)
    y[X2] *= 1.2 * device.delta
    y[V1] = abs(y[V1]) * 0.3 * direction_of(mode)
    if direction_of(mode) != 0 and generator.random() < 0.5:
        y[V1] = -y[V1]  # beyond the end of the slip
    if side_of(mode) != 0:
        y[X2], y[V2] = side_of(mode) * device.delta, 0.0
    return y


def _name(code: int) -> str:
    m = len(GUARDS)
    if code < m:
        return GUARDS[code].name
    return f"chatter ends {'right' if code == m + RIGHT_IMPACT else 'left'}"


def _impact_errors(actuator: Actuator) -> tuple[float, float]:
    """Return the largest relative errors of Equations (5) and (6) over the impacts of a run."""
    run = simulate(actuator, Sine(amplitude=0.24, omega=0.45), 300)
    log = run.trajectory.events
    hits = log[is_impact(log)]
    if len(hits) == 0:
        return np.nan, np.nan

    def momentum(y: Floats) -> Floats:
        total: Floats = (actuator.m1 + actuator.m2) * y[:, V1] + actuator.m2 * y[:, V2]
        return total

    change = np.abs(momentum(hits.after) - momentum(hits.before))
    size = actuator.m2 * np.abs(hits.before[:, V2])
    rebound = -hits.after[:, V2] / hits.before[:, V2]
    return float((change / size).max()), float(np.abs(rebound / actuator.e - 1.0).max())
