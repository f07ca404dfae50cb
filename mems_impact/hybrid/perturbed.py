"""Perturbations carried along a run that is known, over its arcs and through its events.

Written over the engine's contract, for both forms, as `passage`. The run itself is not integrated
again to find its events: it writes them to its buffer, and after each the state is the run's.
So nothing that is asked of perturbations moves the run by a rounding.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from mems_impact.engines import contract
from mems_impact.hybrid.guards import TOLERANCES
from mems_impact.hybrid.passage import differentiate_event, integrate, project
from mems_impact.hybrid.record import (
    ACCUMULATION,
    APPROACH,
    CYCLE,
    GUARD,
    HANDOVER,
    HEAD,
    KIND,
    MODE_AFTER,
    MODE_BEFORE,
    REBASE,
    SECTION_CROSSING,
    SWITCH,
    TIME,
    TRANSITION,
)

NEAREST = 1e-9  # room that is left to differences in time beside a switch of the drive
SLOWEST = 1e-14  # a guard is touched at this rate at least: beyond, perturbations know no bounds
# A column of which an event leaves less than this part has nothing left: differences are no better.
NOTHING = 1e-11
# An event acts on a component that it changes by more, or its rate, or what of a column it keeps.
ACTS = 1e-9
# Columns that shrink, or turn into each other, by more than this between two orthonormalizations
# lose digits: then these come twice as often, until they are no longer needed.
WORN = 1e-3


class Perturbed(NamedTuple):
    """A state of the run and k columns, with what has become of these; changed in place.

    Attributes
    ----------
    y : float array, shape (n (1 + k),)
        The state, its cyclic components zero, then the columns: orthonormal but for their cyclic
        components.
    place : int array, shape (2,)
        Periods completed before the time base, and the mode.
    t : float array, shape (1,)
        Time since the time base.
    shifts : float array, shape (k,)
        How much sooner the events of this instant come for each column: the other way round, later.
    growth : float array, shape (k,)
        Logarithms of what each column has grown by.
    alive : int array, shape (k,)
        0 for a column that an event has left nothing of.
    changed : int array, shape (n,)
        1 for a component that an event has acted on.
    length : float array, shape (1,)
        Time after which columns are made orthonormal again at the latest, up to the time scale.
    """

    y: Any
    place: Any
    t: Any
    shifts: Any
    growth: Any
    alive: Any
    changed: Any
    length: Any


class Setup(NamedTuple):
    """What of a problem is asked on the way, and scratch.

    Attributes
    ----------
    n, m, k, parameters, directions, max_steps : int
        States, guards, columns, parameters; directions in their space, none; steps that an arc may
        take.
    period, scale, width, rtol, atol : float
        `scale` is the problem's time scale, `width` the step of differences.
    cyclic : int array, shape (n,)
        1 for a component that is cyclic.
    records : int array, shape (m,)
        1 for a guard that only records.
    constrained : int array, shape (modes,)
        1 for a mode whose states lie on a manifold.
    switches : float array, shape (s,)
    minima, touches, margin, jump, work
        As of a `Passage` of one segment.
    """

    n: int
    m: int
    k: int
    parameters: int
    directions: int
    max_steps: int
    period: float
    scale: float
    width: float
    rtol: float
    atol: float
    cyclic: Any
    records: Any
    constrained: Any
    switches: Any
    minima: Any
    touches: Any
    margin: Any
    jump: Any
    work: Any


def carry(engine: Any, event: Any, at: Any, setup: Any) -> bool:
    """Carry the columns up to an event, and through it; return whether that went well."""
    n, kind, guard = setup.n, int(event[KIND]), int(event[GUARD])
    passes = kind == TRANSITION and setup.records[guard] == 1
    if passes or kind in (APPROACH, SECTION_CROSSING, HANDOVER):
        return True
    cycle, time = int(event[CYCLE]), event[TIME]
    if kind == ACCUMULATION:
        # What is left of a sequence is told from its last impact on.
        if not stands_at(event, at, setup):
            if not go(engine, cycle, time, at, setup):
                return False
            put(event, HEAD, at, setup)
        rest(engine, guard, at, setup)
        orthonormalize(NOTHING, at, setup)
    if not go(engine, cycle, time, at, setup):
        return False
    put(event, HEAD, at, setup)
    if kind in (TRANSITION, SWITCH):
        cross(engine, event, at, setup)
    at.place[1] = int(event[MODE_AFTER])
    put(event, HEAD + n, at, setup)
    if kind != REBASE:
        constrain(engine, at, setup)
        orthonormalize(NOTHING, at, setup)
    return True


def flow_at(engine: Any, mode: int, t: float, y: Any, dy: Any) -> None:
    """Write the derivative of state and columns into `dy`."""
    contract.flow(engine, mode, t, y, dy)


def put(numbers: Any, first: int, at: Any, setup: Any) -> None:
    """Put the state to `numbers` from `first` on, but for what its cyclic components gathered."""
    for j in range(setup.n):
        at.y[j] = 0.0 if setup.cyclic[j] == 1 else numbers[first + j]


def stands_at(event: Any, at: Any, setup: Any) -> bool:
    """Return whether the columns stand at the state before an event: it completes a sequence."""
    same = True
    for j in range(setup.n):
        same = same and (setup.cyclic[j] == 1 or at.y[j] == event[HEAD + j])
    return same


def ahead_of(at: Any, cycle: int, time: float, setup: Any) -> float:
    """Return how far an instant lies ahead of state and columns."""
    return time + (cycle - at.place[0]) * setup.period - at.t[0]


def go(engine: Any, cycle: int, time: float, at: Any, setup: Any) -> bool:
    """Integrate state and columns up to an instant; return whether that went well.

    They are made orthonormal on the way and at the end. An instant that has come is left as it is.
    """
    if ahead_of(at, cycle, time, setup) <= 0.0:
        return True
    while True:
        while at.t[0] >= setup.period:
            at.t[0] -= setup.period
            at.place[0] += 1
        left = ahead_of(at, cycle, time, setup)
        parts = math.ceil(left / at.length[0])
        end = at.t[0] + left / parts
        if parts <= 1:
            end = time + (cycle - at.place[0]) * setup.period
        mode = at.place[1]
        went = end <= at.t[0] or integrate(engine, mode, at.y, at.t[0], end, setup, 0)
        if not went:
            return False
        whole = 2.0 * (end - at.t[0]) >= at.length[0]  # of a short part nothing is learnt
        at.t[0] = end
        for j in range(setup.k):
            at.shifts[j] = 0.0
        constrain(engine, at, setup)
        least = orthonormalize(0.0, at, setup)
        if least < WORN:
            at.length[0] *= 0.5
        elif whole and least > WORN**0.25 and at.length[0] < setup.scale:
            at.length[0] *= 2.0
        if parts <= 1:
            return True


def constrain(engine: Any, at: Any, setup: Any) -> None:
    """Take from the columns what leads off the manifold on which the mode's states lie."""
    if setup.constrained[at.place[1]] == 1:
        project(engine, at.place[1], at.t[0], at.y, setup, 0)


def cross(engine: Any, event: Any, at: Any, setup: Any) -> None:
    """Carry the columns through the transition of an event, by its saltation matrix.

    A perturbed motion meets the guard sooner by w . grad h / (the rate of h). At a switch of the
    drive it does not; nor at a guard that a transition of this instant has put beyond its zero:
    that one fires when that transition comes.
    """
    n, m, k = setup.n, setup.m, setup.k
    guard, switch = int(event[GUARD]), int(event[KIND]) == SWITCH
    mode, t = int(event[MODE_BEFORE]), at.t[0]
    before, after = setup.work[8], setup.work[9]
    # From the left, where a drive that switches now has not done so yet.
    contract.flow(engine, mode, t - 1e-15 * abs(t), at.y, before)
    differentiate(engine, mode, 2 * m if switch else guard, at, setup)
    rate, beyond = 0.0, True
    if not switch:
        size = gain = 0.0
        rate = setup.margin[0, guard, n + 1]
        for j in range(n):
            slope = setup.margin[0, guard, 1 + j]
            rate += slope * before[j]
            gain += abs(slope)
            size += abs(slope * at.y[j])
        error = setup.rtol * size + setup.atol * gain
        far = TOLERANCES * error + 1e-6 * abs(rate) * setup.scale
        beyond = setup.margin[0, guard, 0] < -far
        rate = math.copysign(max(abs(rate), SLOWEST), rate)
    state = setup.work[10]
    for j in range(n):
        state[j] = at.y[j]
        at.y[j] = event[HEAD + n + j]
    contract.flow(engine, int(event[MODE_AFTER]), t, at.y, after)
    for j in range(n):
        at.y[j] = state[j]
    for i in range(n):
        acts = abs(setup.jump[0, i, n + 1] + before[i] - after[i])
        for j in range(n):
            acts = max(acts, abs(setup.jump[0, i, 1 + j] - (1.0 if i == j else 0.0)))
        at.changed[i] |= int(acts > ACTS)
    for c in range(k):
        if not beyond:
            at.shifts[c] = 0.0
            for j in range(n):
                at.shifts[c] += setup.margin[0, guard, 1 + j] * at.y[n * (1 + c) + j] / rate
        apply(c, before, after, at, setup)


def rest(engine: Any, guard: int, at: Any, setup: Any) -> None:
    """Carry state and columns through the impact without rebound that ends a sequence at `guard`.

    Sooner or later it comes for all perturbed motions, and leaves none of them a gap: impulses that
    follow each other close it, and move the bodies by their masses, as they change velocities. The
    flights that are left out are so low that the instant at which it is taken does not matter.
    """
    n, mode = setup.n, at.place[1]
    none, after, closing = setup.work[8], setup.work[9], setup.work[5]
    for j in range(n):
        none[j] = after[j] = 0.0
    differentiate(engine, mode, setup.m + guard, at, setup)
    move(engine, mode, guard, closing, at, setup)
    closed = 0.0
    for j in range(n):
        closed += setup.margin[0, guard, 1 + j] * closing[j]
    for c in range(setup.k):
        at.shifts[c] = 0.0
        column = n * (1 + c)
        gap = 0.0
        for j in range(n):
            gap += setup.margin[0, guard, 1 + j] * at.y[column + j]
        for j in range(n):
            at.y[column + j] -= gap / closed * closing[j] if closed != 0.0 else 0.0
        apply(c, none, after, at, setup)
    at.place[1] = contract.transition(engine, mode, setup.m + guard, at.t[0], at.y)


def move(engine: Any, mode: int, guard: int, moved: Any, at: Any, setup: Any) -> None:
    """Write into `moved` how the state changes, by and by, after an impulse of the contact `guard`.

    The impulse is what the impact makes of a state of another closing speed: the derivative of the
    transition along the gradient of the rate. MARGIN and JUMP are those of the contact.
    """
    n, rate = setup.n, setup.m + guard
    x, behind = setup.work[0], setup.work[6]
    for i in range(n):
        moved[i] = -setup.margin[0, rate, 1 + i]
        for j in range(n):
            moved[i] += setup.jump[0, i, 1 + j] * setup.margin[0, rate, 1 + j]
    length = length_of(moved, 0, n)
    h = setup.width / length if length > 0.0 else 0.0
    for i in range(n, at.y.size):
        x[i] = 0.0  # no columns
    for i in range(n):
        x[i] = at.y[i] - h * moved[i]
    contract.flow(engine, mode, at.t[0], x, behind)
    for i in range(n):
        x[i] = at.y[i] + h * moved[i]
    contract.flow(engine, mode, at.t[0], x, moved)
    for i in range(n):
        moved[i] -= behind[i]


def differentiate(engine: Any, mode: int, code: int, at: Any, setup: Any) -> None:
    """Differentiate margins and the transition `code` here and now, into MARGIN and JUMP."""
    t, room = at.t[0], math.inf
    for i in range(setup.switches.size):
        since = abs(t - setup.switches[i]) % setup.period
        room = max(min(room, since, setup.period - since), NEAREST)
    differentiate_event(engine, mode, code, t, at.y, room, setup, 0)


def apply(c: int, before: Any, after: Any, at: Any, setup: Any) -> None:
    """Apply the transition to column `c`, with the flow `before` and `after` it.

    For a motion that comes to it sooner by its shift, the flow after it acts for so much longer and
    the flow before it for so much less.
    """
    n, column, shift = setup.n, setup.n * (1 + c), at.shifts[c]
    result = setup.work[10]
    length = most = 0.0
    for i in range(n):
        most = max(most, abs(at.y[column + i]) if setup.cyclic[i] == 0 else 0.0)
        kick = after[i] - setup.jump[0, i, n + 1]
        parts = abs(after[i]) + abs(setup.jump[0, i, n + 1])
        for j in range(n):
            kick -= setup.jump[0, i, 1 + j] * before[j]
            parts += abs(setup.jump[0, i, 1 + j] * before[j])
        result[i] = kick * shift if shift != 0.0 else 0.0
        parts = parts * abs(shift) if shift != 0.0 else 0.0
        for j in range(n):
            moved = setup.jump[0, i, 1 + j] * at.y[column + j]
            result[i] += moved
            parts += abs(moved)
        if setup.cyclic[i] == 0:
            length = max(length, abs(result[i]))
            most = max(most, parts)
    if length <= NOTHING * most:
        at.alive[c] = 0
    for i in range(n):
        at.y[column + i] = result[i]


def orthonormalize(nothing: float, at: Any, setup: Any) -> float:
    """Make the columns orthonormal, and take down what they have grown by.

    Each against those before it, twice, so that all digits are kept. Returns how much was left of
    the column of which least was. One of which no more than the part `nothing` was is zero from
    then on.
    """
    n, least = setup.n, 1.0
    for c in range(setup.k):
        column = n * (1 + c)
        for i in range(n):
            if setup.cyclic[i] == 1 or at.alive[c] == 0:
                at.y[column + i] = 0.0
        if at.alive[c] == 0:
            at.shifts[c] = 0.0
            continue
        whole = length_of(at.y, column, n)
        for _ in range(2):
            for other in range(c):
                former = n * (1 + other)
                part = 0.0
                for i in range(n):
                    part += at.y[column + i] * at.y[former + i]
                for i in range(n):
                    at.y[column + i] -= part * at.y[former + i]
                at.shifts[c] -= part * at.shifts[other]
        length = length_of(at.y, column, n)
        if not length > nothing * whole:
            at.alive[c] = 0
            at.shifts[c] = 0.0
            for i in range(n):
                at.y[column + i] = 0.0
            continue
        least = min(least, length, length / whole)
        at.growth[c] += math.log(length)
        at.shifts[c] /= length
        for i in range(n):
            at.y[column + i] /= length
    return least


def length_of(y: Any, column: int, n: int) -> float:
    """Return the length of the n numbers of `y` from `column` on."""
    square = 0.0
    for i in range(n):
        square += y[column + i] * y[column + i]
    return math.sqrt(square)
