"""The actuator by heyoka's Taylor integrator: a judge of the package, and its rival in speed.

Written from Equations (1) to (6) of the paper and nothing of `mems_impact`. Everything is compiled
once; the friction mode and the drive are parameters of the compiled integrator, impacts and the
ends of slips its terminal events, so that Python runs only between arcs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

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
        options = {} if tol == 0.0 else {"tol": tol}
        self.integrator = hy.taylor_adaptive(
            flow,
            [0.0] * 4,
            t_events=[hy.t_event(equation, direction=way) for equation, way in equations],
            pars=[0.0, 0.0, 1.0, 0.0],
            **options,
        )

    def load(self, t: float, y: np.ndarray) -> float:
        """What the block exerts on the frame, Equation (3)."""
        p, par = self.p, self.integrator.pars
        voltage = par[AMPLITUDE] * math.cos(par[OMEGA] * t) + par[BIAS]
        return p["k"] * y[2] + p["c"] * y[3] - p["alpha"] * (voltage / (p["d"] - y[2])) ** 2

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
        ta, p = self.integrator, self.p
        state, par = ta.state, ta.pars
        until, static = ta.propagate_until, self.static
        e, share = p["e"], (1.0 + p["e"]) * p["m2"] / (p["m1"] + p["m2"])
        done = int(hy.taylor_outcome.time_limit)
        ta.reset_cooldowns()
        ta.time = 0.0
        state[:] = start
        par[:] = (0.0, *drive)
        if abs(self.load(0.0, state)) > static:
            par[DIRECTION] = math.copysign(1.0, self.load(0.0, state))
        while True:
            outcome = int(until(t_end)[0])
            if outcome == done:
                return state.copy()
            if not -len(self.kinds) <= outcome < 0:
                raise RuntimeError(f"heyoka stopped with {outcome} at t = {ta.time}")
            kind = self.kinds[-1 - outcome]  # outcome -1 is the first event, and so on
            if kind <= LEFT:
                v2 = state[3]
                v1 = state[1] + share * v2
                state[1] = v1
                state[3] = -e * v2
                par[DIRECTION] = 0.0 if v1 == 0.0 else math.copysign(1.0, v1)
            else:
                state[1] = 0.0
                load = self.load(ta.time, state)
                slips = kind == BREAK_AWAY or abs(load) > static
                par[DIRECTION] = math.copysign(1.0, load) if slips else 0.0
            if log is not None:
                log.append((kind, ta.time, state.copy()))
