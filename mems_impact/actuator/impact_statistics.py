"""Impacts, groups of impacts (blows), and rests of a device."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.actuator import impact_law
from mems_impact.actuator.automaton import GUARDS, MODES, RELEASE, SLIP_END, direction_of, side_of
from mems_impact.actuator.equations import V2, X1
from mems_impact.actuator.model import layout
from mems_impact.actuator.parameters import ActuatorParameters
from mems_impact.actuator.terms.base import is_compliant
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import Events
from mems_impact.systems.window_statistics import Moments

# --- Impacts and steps of the frame

# By mode; further modes, in which a current is limited, repeat these.
_DIRECTIONS = np.array([direction_of(mode) for mode in range(len(MODES))])
_SIDES = np.array([side_of(mode) for mode in range(len(MODES))])


def is_slipping(modes: Any) -> Any:
    """Return whether the frame slips, by number of the mode."""
    return _DIRECTIONS[modes % len(MODES)] != 0


def contact_side(modes: Any) -> Any:
    """Return 1 for rest on the right stopper, -1 on the left one, else 0, by number of the mode."""
    return _SIDES[modes % len(MODES)]


def is_impact(events: Events) -> NDArray[np.bool_]:
    """Return which rows are impacts."""
    return events.impacts_among(GUARDS)


def is_release(events: Events) -> NDArray[np.bool_]:
    """Return which rows are releases from a stopper, of either kind."""
    return (events.kind == workspace.TRANSITION) & (events.guard == RELEASE)


def contact_loss(actuator: ActuatorParameters) -> int:
    """Return the index of the state that integrates the losses in compliant stoppers."""
    states = layout([term.kind for term in actuator.terms], 0).states
    return states.index("contact_loss")


def energy_lost(events: Events, actuator: ActuatorParameters) -> Floats:
    """Return the energy that each row loses: impacts, and the rest of chatter sequences.

    The loss of a contact with a compliant stopper is known at its end; NaN if it has not ended.
    """
    if not is_compliant(actuator):
        speeds = events.before[:, V2], events.after[:, V2]
        loss: Floats = impact_law.impact_loss(actuator.m1, actuator.m2, *speeds)
        return np.where(is_impact(events) | (events.kind == workspace.ACCUMULATION), loss, 0.0)
    rows = np.flatnonzero(is_impact(events))
    ends = np.flatnonzero(is_release(events) | (events.kind == workspace.ACCUMULATION))
    total = events.after[:, contact_loss(actuator)]
    indices = np.searchsorted(ends, rows)
    ended = indices < ends.size
    loss = np.zeros(len(events))
    loss[rows] = math.nan
    loss[rows[ended]] = total[ends[indices[ended]]] - total[rows[ended]]
    return loss


def frame_steps(events: Events) -> tuple[NDArray[np.int64], Floats]:
    """Return the rows of the k impacts and the step of the frame after each of them, shape (k,).

    A step is the displacement of the frame from an impact until the frame rests or the next impact,
    whichever is first; NaN if neither has occurred.
    """
    impact = is_impact(events)
    rows = np.flatnonzero(impact)
    # A compliant contact that starts with the frame at rest may still move it.
    comes = is_slipping(events.mode_before) | np.isin(events.guard, (RELEASE, SLIP_END))
    rests = ~is_slipping(events.mode_after) & events.starts_arc & comes
    ends = np.flatnonzero(impact | rests)
    x1 = events.after[:, X1]
    # An impact that leaves the frame at rest ends its own step, of length zero.
    indices = np.searchsorted(ends, rows, side="right")
    steps = np.full(rows.size, math.nan)
    ended = indices < ends.size
    steps[ended] = x1[ends[indices[ended]]] - x1[rows[ended]]
    struck = events.before[rows, V2] != events.after[rows, V2]  # else a contact begins
    steps[struck & ~is_slipping(events.mode_after[rows])] = 0.0
    return rows, steps


# --- Blows


def blow_of(log: Events) -> tuple[NDArray[np.int64], int]:
    """Return the row of the first impact of the blow of each row, and the number of settled rows.

    `log` has impacts and ends of chatter only; an end of chatter without an impact in the log has
    the row -1. Later events do not affect the settled rows: at the row after them a chatter
    sequence starts that may still end in rest.
    """
    indices = np.arange(len(log))
    ends = log.kind == workspace.ACCUMULATION
    speed = np.abs(log.before[:, V2])
    goes_on = np.zeros(len(log), dtype=bool)
    goes_on[1:] = (log.guard[1:] == log.guard[:-1]) & ~ends[:-1]
    goes_on[1:] &= ends[1:] | (speed[1:] < speed[:-1])
    start = np.maximum.accumulate(np.where(goes_on, 0, indices))
    rests = np.zeros(len(log), dtype=bool)
    rests[start[ends & goes_on]] = True
    first = np.where(rests[start], start, indices)
    first[ends & ~goes_on] = -1
    settled = int(start[-1]) if len(log) and not ends[-1] else len(log)
    return first, settled


def contacts(events: Events) -> tuple[Events, Floats]:
    """Return the impacts and ends of chatter among events, and the step of the frame after each.

    Steps are as in `frame_steps` after impacts, 0 after the end of chatter.
    """
    chosen = _chosen(events)
    hits, moved = frame_steps(events)
    steps = np.zeros(len(events))
    steps[hits] = moved
    return events[chosen], steps[chosen]


def _chosen(events: Events) -> NDArray[np.bool_]:
    return is_impact(events) | (events.kind == workspace.ACCUMULATION)


class BlowCounter:
    """Accumulates the number and displacements of blows, chunk by chunk of impacts.

    The accumulator keeps the rows of one chatter sequence, which may still end in rest.
    Displacements are of blows whose last step has ended.
    """

    def __init__(self) -> None:
        self.count = 0
        self.displacements = Moments()
        self._held: tuple[Events, Floats, NDArray[np.bool_]] | None = None

    def add(self, log: Events, steps: Floats, inside: NDArray[np.bool_], *, last: bool) -> None:
        """Process the next rows, results of `contacts`; `last` tells that none follow.

        A blow that starts with a row counts if the row is `inside`.
        """
        if self._held is not None:
            events, before, within = self._held
            log = Events.joined([events, log])
            steps, inside = np.concatenate([before, steps]), np.concatenate([within, inside])
        first, settled = blow_of(log)
        counted = len(log) if last else settled
        begins = np.flatnonzero((first == np.arange(len(log))) & inside)
        begins = begins[begins < counted]
        self.count += begins.size
        moved = _sums(first, steps)[begins]
        self.displacements.add(moved[~np.isnan(moved)])
        self._held = (log[counted:], steps[counted:], inside[counted:])


@dataclass(frozen=True)
class BlowTable:
    """The blows among events, one per row."""

    rows: NDArray[np.int64]  # of their first impacts, among the events
    first: Events  # these
    impacts: NDArray[np.int64]
    rests: NDArray[np.bool_]  # whether they end in rest on the stopper
    # Of the frame, until it rests or the next blow; NaN if neither has occurred.
    displacement: Floats
    energy: Floats  # kinetic energy lost


def each_blow(events: Events, actuator: ActuatorParameters) -> BlowTable:
    """Return the blows among events, in which `RestDetector` has marked the ends of contacts."""
    log, steps = contacts(events)
    first, _ = blow_of(log)
    begins = first == np.arange(len(log))
    ends = log.kind == workspace.ACCUMULATION
    return BlowTable(
        rows=np.flatnonzero(_chosen(events))[begins],
        first=log[begins],
        impacts=_sums(first, ~ends)[begins].astype(np.int64),
        rests=_sums(first, ends)[begins] > 0.0,
        displacement=_sums(first, steps)[begins],
        energy=_sums(first, energy_lost(events, actuator)[_chosen(events)])[begins],
    )


def _sums(first: NDArray[np.int64], values: NDArray[Any]) -> Floats:
    """Return the sum of the values of each blow at its first row; 0 in other rows."""
    sums = np.zeros(first.size)
    member = first >= 0
    np.add.at(sums, first[member], values[member])
    return sums


# --- Rest on compliant stoppers

MAX_BOUNCE_RATIO = 2.0  # largest extension of a bounce by a pressing force (exponent 1)


class RestDetector:
    """Distinguishes bounces off compliant stoppers from rest on them, chunk by chunk of events.

    A bounce lasts up to two of its `contact_time`; a longer contact is rest. The event at its end
    is marked like the end of a chatter sequence on a rigid stopper. Actuator and forcing period are
    in the units of the numerics.
    """

    def __init__(self, actuator: ActuatorParameters, period: float) -> None:
        self._actuator, self._period = actuator, period
        self._yields = is_compliant(actuator)
        self._hits = np.zeros((0, 3))  # the last impact so far: time, speed, guard

    def __call__(self, events: Events) -> Events:
        """Process the next events; return them with ends of rest marked."""
        if not self._yields:
            return events
        time = events.cycle * self._period + events.time
        impact = is_impact(events)
        new = np.stack([time, np.abs(events.before[:, V2]), events.guard], axis=1)[impact]
        hits = np.concatenate([self._hits, new])
        hit_counts = np.cumsum(impact) + len(self._hits)  # hits until each event
        ends = np.flatnonzero(is_release(events) & (hit_counts > 0))
        begun = hits[hit_counts[ends] - 1]
        lasted = time[ends] - begun[:, 0]
        rests = lasted > MAX_BOUNCE_RATIO * contact_time(self._actuator, begun[:, 1])
        self._hits = hits[-1:]
        kind, guard = events.kind.copy(), events.guard.copy()
        kind[ends[rests]] = workspace.ACCUMULATION
        guard[ends[rests]] = begun[rests, 2].astype(np.int64)
        return replace(events, kind=kind, guard=guard)


def contact_time(actuator: ActuatorParameters, speed: Floats) -> Floats:
    """Return the duration of contact with a compliant stopper for impacts with `speed`.

    For a frame at rest, without damping and other forces, it is the quadrature of the energy,
    m2 s'^2/2 + K s^(n+1)/(n+1) = m2 speed^2/2 at the depth s (Johnson, Contact Mechanics, 1985,
    Section 11.4). The actuator has a `CompliantStopper`.
    """
    (stopper,) = (dict(term) for term in actuator.terms if term.replaced_rule == "stopper")
    power = stopper["exponent"] + 1.0
    factor = stopper["stiffness"] / stopper["depth"] ** (power - 2.0)
    deepest = (0.5 * power * actuator.m2 * speed * speed / factor) ** (1.0 / power)
    shape = math.sqrt(math.pi) * math.gamma(1.0 + 1.0 / power) / math.gamma(0.5 + 1.0 / power)
    still: NDArray[np.bool_] = speed == 0.0
    time: Floats = 2.0 * shape * deepest / np.where(still, 1.0, speed)
    return np.where(still, 0.0, time)
