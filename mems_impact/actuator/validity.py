"""Whether a run stayed where the terms of its model hold."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from mems_impact.actuator.terms.base import Limit
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.trajectory import Events, Floats, Instant
from mems_impact.units import Scales
from mems_impact.warnings import ValidityWarning

__all__ = ["Validity"]


class Validity:
    """The limits of terms, looked at where a run has events, and at its ends.

    Impacts, turning points and passages through the middle are events: the smallest gaps and the
    largest speeds are among them.
    """

    def __init__(
        self, limits: Sequence[Limit], problem: Problem, start: Instant, scales: Scales
    ) -> None:
        self.limits, self.problem, self.scales = limits, problem, scales
        self.worst = [(0.0, 0.0)] * len(limits)  # value and time
        self._look(start.y[None], np.array([self._time(start)]))

    def __call__(self, events: Events) -> None:
        """Take a chunk of events in."""
        if len(events):
            times = events.cycle * self.problem.period + events.time
            self._look(events.before, times)
            self._look(events.after, times)

    def tell(self, final: Instant) -> None:
        """Warn, once for each limit that the run has left behind."""
        self._look(final.y[None], np.array([self._time(final)]))
        for limit, (value, time) in zip(self.limits, self.worst, strict=True):
            if value > limit.most:
                when = float(self.scales.out(time, "s"))
                message = f"{limit.what} is {value:.3g} at t = {when:.6g}"
                told = f"{message}, and the model holds up to {limit.most:g}"
                warnings.warn(told, ValidityWarning, stacklevel=5)

    def _look(self, states: Floats, times: Floats) -> None:
        for i, limit in enumerate(self.limits):
            values = np.asarray(limit.value(states.T, self.problem.parameters))
            row = int(np.argmax(values))
            if values[row] > self.worst[i][0]:
                self.worst[i] = float(values[row]), float(times[row])

    def _time(self, instant: Instant) -> float:
        return float(instant.cycle * self.problem.period + instant.time)
