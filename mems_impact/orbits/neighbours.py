"""The orbits beside one, as a parameter goes on: to first order, or solved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mems_impact.errors import OrbitError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.hybrid.variational import Arc, Event
from mems_impact.orbits.gradients import rate_gradient, touch_gradient
from mems_impact.orbits.newton import solve
from mems_impact.orbits.orbit import PeriodicOrbit, make_orbit

SINGULAR = 1e-12  # of the Jacobian's largest singular value: there the orbit stands at a fold


class Neighbours:
    """The orbits of the same signature beside `orbit`, as one of its parameters goes on.

    The shooting equations F(u, p) = 0 hold along them, so that their unknowns move at the rate
    du/dp = -(dF/du)^-1 dF/dp, and all else at the rate that the variational equations give.

    Parameters
    ----------
    orbit : PeriodicOrbit
    parameter : str
        Of the orbit's family.

    Raises
    ------
    OrbitError
        If the orbit stands at a fold: it has no derivative there.
    """

    def __init__(self, orbit: PeriodicOrbit, parameter: str) -> None:
        self._orbit, self._parameter = orbit, parameter
        self._value = orbit.family.value(parameter)
        self._shooting = shooting = orbit.equations((parameter,))
        self._point = point = shooting.evaluate(orbit.point.unknowns, np.array([self._value]))
        sizes = np.linalg.svd(point.jacobian, compute_uv=False)
        if not sizes[-1] > SINGULAR * sizes[0]:
            raise OrbitError(
                "the orbit stands at a fold, where it has no derivative",
                "move a parameter away from the fold",
            )
        self._rate = np.linalg.solve(point.jacobian, -point.by_parameter[:, 0])
        self._by_both = np.append(self._rate, 1.0)
        self._arcs = [self._arc_rates(i) for i in range(len(shooting.segments))]

    def to_first_order(self, step: float) -> PeriodicOrbit:
        """Return what the orbit is to first order at a parameter larger by `step`.

        States, times, margins and rates of events are moved. Multipliers are not known: NaN.
        """
        shooting, before, value = self._shooting, self._point, self._value + step
        unknowns = before.unknowns + step * self._rate
        setting = shooting.setting(np.array([value]))
        if shooting.phase is not None:
            setting = setting.lasting(shooting.unit * float(unknowns[-1]))
        starts, ends, _, _ = shooting.layout.instants(setting, shooting.unpack(unknowns)[1])
        moved = [self._moved(i, step) for i in range(len(before.arcs))]
        point = replace(
            before,
            unknowns=unknowns,
            setting=setting,
            starts=starts,
            ends=ends,
            arcs=tuple(arc for arc, _ in moved),
            events=tuple(event for _, event in moved),
        )
        return replace(
            self._orbit,
            family=self._orbit.family.at(**{self._parameter: value}),
            shooting=shooting,
            point=point,
            multipliers=np.full(self._orbit.multipliers.shape, np.nan, dtype=complex),
        )

    def solved(self, step: float) -> PeriodicOrbit:
        """Return the orbit at a parameter larger by `step`, admissible or not.

        Raises
        ------
        OrbitError
            If none is found there.
        """
        guess = self._point.unknowns + step * self._rate
        return make_orbit(
            self._shooting, solve(self._shooting, guess, np.array([self._value + step]))
        )

    def _arc_rates(self, i: int) -> tuple[Floats, Floats, Floats, float]:
        """Return the derivatives of the end of arc `i`, of what follows, of minima, of the rate."""
        shooting, point = self._shooting, self._point
        arc, event, own = point.arcs[i], point.events[i], shooting.segments[i].guard(shooting.m)
        layout, times = shooting.layout, shooting.unpack(point.unknowns)[1]
        _, _, start_rates, end_rates = layout.instants(point.setting, times)
        end = point.end_by_unknown[i] @ self._rate + point.end_by_parameter[i, :, 0]
        # A start that moves cuts off what cyclic states had gathered before, of which the
        # equations know nothing.
        begins = float(layout.by_start[i] @ self._rate + start_rates[i, 0])
        cyclic = list(shooting.automaton.cyclic)
        end[cyclic] -= begins * arc.slope_start[cyclic]
        minima = np.zeros(shooting.m)
        for guard in np.flatnonzero(np.isfinite(arc.minima)).tolist():
            minima[guard] = touch_gradient(shooting, point, i, guard) @ self._by_both
        if event is None:
            return end, end, minima, 0.0
        instant = layout.by_end[i] @ self._rate + end_rates[i, 0]
        after = event.jump_by_state @ end + event.jump_by_time * instant
        after = after + event.jump_by_parameter[:, 0] * point.setting.scales[0]
        rate = 0.0
        if own >= 0 and i in shooting.events:
            rate = float(rate_gradient(shooting, point, i, own) @ self._by_both)
        return end, after, minima, rate

    def _moved(self, i: int, step: float) -> tuple[Arc, Event | None]:
        end, after, minima, rate = self._arcs[i]
        arc, event = self._point.arcs[i], self._point.events[i]
        arc = arc._replace(end=arc.end + step * end, minima=arc.minima + step * minima)
        if event is None:
            return arc, None
        rates, own = event.rates.copy(), self._shooting.segments[i].guard(self._shooting.m)
        if own >= 0:
            rates[own] += step * rate
        return arc, event._replace(after=event.after + step * after, rates=rates)
