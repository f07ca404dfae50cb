"""Which rows and columns of the shooting equations belong to what."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mems_impact.hybrid.passage import NO_EVENT
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.setting import Setting
from mems_impact.orbits.signature import BOUNDARY

if TYPE_CHECKING:
    from mems_impact.orbits.shooting import Shooting


class Layout:
    """Which rows and columns of the equations belong to what; the signature says it all."""

    def __init__(self, shooting: Shooting) -> None:
        segments, events, f = shooting.segments, shooting.events, len(shooting.free)
        count = len(segments)
        size = f * count + len(events) + (shooting.phase is not None)
        self.codes = np.array(
            [(s.mode, NO_EVENT if s.code == BOUNDARY else s.code) for s in segments],
            dtype=np.int64,
        )
        self.guards = np.array([segments[i].code % shooting.m for i in events], dtype=np.int64)
        self.events = np.array(events, dtype=np.int64)
        # Segments that begin where the one before ends, not with a period.
        self.follows = np.array(
            [i > 0 and segments[i - 1].cycle == s.cycle for i, s in enumerate(segments)]
        )
        self.by_end, self.by_start = np.zeros((count, size)), np.zeros((count, size))
        self.by_end[self.events, f * count + np.arange(len(events))] = shooting.unit
        self.period_ends = self.codes[:, 1] == NO_EVENT
        if shooting.phase is not None:
            self.by_end[self.period_ends, -1] = shooting.unit
        self.by_start[self.follows] = self.by_end[:-1][self.follows[1:]]
        # An event's margin stands before the states that follow on it.
        first = np.cumsum([i in events for i in range(count)]) + f * np.arange(count)
        self.state_rows = first[:, None] + np.arange(f)
        self.guard_rows = first[self.events] - 1
        columns = f * np.arange(count)[:, None] + np.arange(f)
        self.identity = np.zeros((size, size))
        self.identity[self.state_rows, np.roll(columns, -1, axis=0)] = 1.0
        self.own_state = (*np.ix_(range(count), range(shooting.n), range(f))[:2], columns[:, None])
        self.at_switch = self.codes[:, 1] == shooting.automaton.switch_code
        self.switch = np.array([s.switch for s in segments], dtype=np.int64)

    def instants(self, setting: Setting, times: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return starts and ends of the segments, and their derivatives by the parameters.

        These are of ends that are no unknowns.
        """
        count = len(self.codes)
        ends, end_rates = np.zeros(count), np.zeros((count, setting.values.size))
        ends[self.events] = times
        ends[self.period_ends], end_rates[self.period_ends] = setting.period, setting.period_rates
        if self.at_switch.any():
            switch = self.switch[self.at_switch]
            ends[self.at_switch] = setting.switches[switch]
            end_rates[self.at_switch] = setting.switch_rates[:, switch].T
        starts, start_rates = np.zeros(count), np.zeros_like(end_rates)
        starts[self.follows] = ends[:-1][self.follows[1:]]
        start_rates[self.follows] = end_rates[:-1][self.follows[1:]]
        return starts, ends, start_rates, end_rates

    def passage(
        self, setting: Setting, starts: Floats, ends: Floats
    ) -> tuple[Floats, Floats | None]:
        """Return times and motions for `Variational.traverse`."""
        rooms, looked = np.full(ends.size, math.inf), ends
        if not setting.switches.size:
            return np.stack([starts, ends, rooms, looked], axis=1), None
        rooms[self.events] = [setting.room(time) for time in ends[self.events].tolist()]
        looked = np.where(self.at_switch, np.nextafter(ends, 0.0), ends)  # before it switches
        motions = [setting.motion(*span) for span in zip(starts, ends, strict=True)]
        return np.stack([starts, ends, rooms, looked], axis=1), np.array(motions)
