"""The transitions of the actuator's automaton, found by letting its guards fire (Fig. 2).

Nothing here knows the rules. Every mode is put into very many states in which it may be, under
several voltages and devices; every guard that watches it is let fire on its boundary; where the
transition leads is counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.automaton import (
    GUARDS,
    MODES,
    RELEASE,
    RIGHT_IMPACT,
    direction_of,
    side_of,
)
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.equations import STATES, V1, V2, X2
from mems_impact.hybrid.automaton import Automaton

__all__ = ["Transition", "code_name", "transitions"]

BISECTIONS = 60
Transition = tuple[int, int, int]  # mode, code, mode


def transitions(actuator: Actuator, samples: int) -> Counter[Transition]:
    """Return how often each (mode, code, mode) was seen.

    Parameters
    ----------
    actuator : Actuator
        Dimensionless; a second one with weak friction is tried beside it, since this frame never
        breaks away under the voltages of the paper.
    samples : int
        Random states tried for every device.
    """
    automaton = actuator.under(Sine(amplitude=1.0, omega=1.0)).automaton
    weak = actuator.replace(mu_s=actuator.mu_s / 200.0, mu_d=actuator.mu_d / 200.0)
    generator = np.random.default_rng(0)
    seen: Counter[Transition] = Counter()
    for device in (actuator, weak):
        for _ in range(samples):
            seen.update(_trial(automaton, device, generator))
    return seen


def _trial(
    automaton: Automaton, device: Actuator, generator: np.random.Generator
) -> Iterator[Transition]:
    """Put one mode into a random state on one of its guards and let that fire."""
    m = len(GUARDS)
    drive = Sine(amplitude=float(generator.uniform(0.05, 1.6) ** 2), omega=1.0)
    p = device.under(drive).numbers().parameters
    t = float(generator.uniform(0.0, np.pi))
    mode, guard = int(generator.integers(len(MODES))), int(generator.integers(m))

    def margin(y: Floats) -> tuple[float, float]:
        g, r = np.ones(m), np.ones(m)  # a guard without a margin in this mode
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


def _by_time(
    automaton: Automaton, mode: int, guard: int, y: Floats, p: Floats
) -> Iterator[Transition]:
    """Let time go until the guard fires, the state held."""
    m = len(GUARDS)
    g, r = np.ones(m), np.ones(m)  # a guard without a margin in this mode

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
    g, r = np.ones(m), np.ones(m)  # a guard without a margin in this mode
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


def code_name(code: int) -> str:
    """Return the name of the event with that code."""
    m = len(GUARDS)
    if code < m:
        return GUARDS[code].name
    return f"chatter ends {'right' if code == m + RIGHT_IMPACT else 'left'}"
