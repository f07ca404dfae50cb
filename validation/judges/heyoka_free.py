"""The actuator by heyoka's Taylor integrator: a judge of the package, and its rival in speed.

Written from Equations (1) to (6) of the paper and nothing of `mems_impact`. Everything is compiled
once; the friction mode and the drive are parameters of the compiled integrator, impacts and the
ends of slips its terminal events, so that Python runs only between arcs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import heyoka as hy
import numpy as np

RIGHT, LEFT, SLIP_END, BREAK_AWAY = range(4)

# Runtime parameters: direction of slip (0: stuck), amplitude, frequency, bias.
DIRECTION, AMPLITUDE, OMEGA, BIAS = range(4)


class Heyoka:
    """Equations (1) to (6), free block, frame stuck or slipping.

    Parameters
    ----------
    p : mapping
        The paper's parameters by name: m1, m2, k, c, d, delta, e, mu_s, mu_d, alpha, g.
    tol : float
        heyoka's tolerance of the local error; 0 for machine precision.
    break_away : bool
        Watch for a stuck frame breaking away; can be left out where friction is strong.
    """

    def __init__(self, p: Mapping[str, float], tol: float = 0.0, break_away: bool = True) -> None:
        self.p = dict(p)
        weight = (p["m1"] + p["m2"]) * p["g"]
        self.static, dynamic = p["mu_s"] * weight, p["mu_d"] * weight
        x1, v1, x2, v2 = hy.make_vars("x1", "v1", "x2", "v2")
        s, amplitude, omega, bias = (hy.par[i] for i in range(4))
        voltage = amplitude * hy.cos(omega * hy.time) + bias
        gap = p["d"] - x2
        load = p["k"] * x2 + p["c"] * v2 - p["alpha"] * voltage**2 / gap**2
        frame = (s * s * load - s * dynamic) / p["m1"]
        flow = [(x1, v1), (v1, frame), (x2, v2), (v2, -load / p["m2"] - frame)]

        falling = hy.event_direction.negative
        equations = [
            (p["delta"] - x2, falling),
            (p["delta"] + x2, falling),
            # A stuck frame has v1 = 0 throughout: a constant keeps the event away.
            (s * v1 + (1.0 - s * s), falling),
        ]
        if break_away:
            equations += [
                ((1.0 - s * s) * (self.static - load) + s * s, falling),
                ((1.0 - s * s) * (self.static + load) + s * s, falling),
            ]
        kinds = [RIGHT, LEFT, SLIP_END, BREAK_AWAY, BREAK_AWAY]
        self.kinds = kinds[: len(equations)]
        self.flow, self.equations = flow, equations
        self.options = {} if tol == 0.0 else {"tol": tol}
        self.integrator = hy.taylor_adaptive(
            flow,
            [0.0] * 4,
            t_events=[hy.t_event(equation, direction=way) for equation, way in equations],
            pars=[0.0, 0.0, 1.0, 0.0],
            **self.options,
        )

    def batch(self, width: int) -> hy.taylor_adaptive_batch_dbl:
        """Return an integrator of `width` trajectories, with transitions as callbacks in Python."""

        def callback(kind: int) -> Callable[[hy.taylor_adaptive_batch_dbl, int, int], bool]:
            def transit(ta: hy.taylor_adaptive_batch_dbl, sign: int, i: int) -> bool:
                self.transit(kind, ta.time[i], ta.state[:, i], ta.pars[:, i])
                return True

            return transit

        events = [
            hy.t_event_batch(equation, callback=callback(kind), direction=way)
            for kind, (equation, way) in zip(self.kinds, self.equations, strict=True)
        ]
        empty = np.zeros((4, width))
        return hy.taylor_adaptive_batch(
            self.flow, empty, t_events=events, pars=empty.copy(), **self.options
        )

    def load(self, t: float, y: np.ndarray, par: np.ndarray) -> float:
        """What the block exerts on the frame, Equation (3)."""
        p = self.p
        voltage = par[AMPLITUDE] * math.cos(par[OMEGA] * t) + par[BIAS]
        return p["k"] * y[2] + p["c"] * y[3] - p["alpha"] * (voltage / (p["d"] - y[2])) ** 2

    def transit(self, kind: int, t: float, y: np.ndarray, par: np.ndarray) -> None:
        """Apply an event's transition to a state and its parameters, in place."""
        p = self.p
        if kind <= LEFT:
            v1 = y[1] + (1.0 + p["e"]) * p["m2"] / (p["m1"] + p["m2"]) * y[3]
            y[1] = v1
            y[3] *= -p["e"]
            par[DIRECTION] = 0.0 if v1 == 0.0 else math.copysign(1.0, v1)
        else:
            y[1] = 0.0
            load = self.load(t, y, par)
            slips = kind == BREAK_AWAY or abs(load) > self.static
            par[DIRECTION] = math.copysign(1.0, load) if slips else 0.0

    def run(
        self,
        drive: tuple[float, float, float],
        start: tuple[float, float, float, float],
        t_end: float,
        log: list[tuple[int, float, np.ndarray]] | None = None,
    ) -> np.ndarray:
        """Integrate from t = 0 and `start` = (x1, v1 = 0, x2, v2) to `t_end`; the final state.

        Every impact, end of slip and break-away is appended to `log`: (kind, t, state after).
        """
        ta = self.integrator
        state, par = ta.state, ta.pars
        until = ta.propagate_until
        done = int(hy.taylor_outcome.time_limit)
        ta.reset_cooldowns()
        ta.time = 0.0
        state[:] = start
        par[:] = (0.0, *drive)
        load = self.load(0.0, state, par)
        if abs(load) > self.static:
            par[DIRECTION] = math.copysign(1.0, load)
        while True:
            outcome = int(until(t_end)[0])
            if outcome == done:
                return state.copy()
            if not -len(self.kinds) <= outcome < 0:
                raise RuntimeError(f"heyoka stopped with {outcome} at t = {ta.time}")
            kind = self.kinds[-1 - outcome]  # outcome -1 is the first event, and so on
            self.transit(kind, ta.time, state, par)
            if log is not None:
                log.append((kind, ta.time, state.copy()))
