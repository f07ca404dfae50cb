"""The step of the frame after an impact: formula and simulation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.actuator import equations as eq
from mems_impact.actuator.automaton import RIGHT_IMPACT
from mems_impact.actuator.design.static_forces import StaticForces, contact_amount
from mems_impact.actuator.equations import V1, V2, X2
from mems_impact.actuator.impact_statistics import frame_steps
from mems_impact.actuator.model import Model, compose
from mems_impact.actuator.parameters import ActuatorParameters, numbers_for
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.simulation import Events
from mems_impact.tables import table

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike


def coasting(model: Model, y: Floats, voltages: tuple[float, float, float], p: Floats) -> float:
    """Return the distance that the frame slides to the right from a state under constant forces.

    The result is infinite if the forces overcome friction. The voltages are of the right and left
    electrode and of a clamp.
    """
    pull = model.pull(*voltages[:2], y, p) + model.force(y, p)
    push = eq.load(y[X2], y[V2], pull, p) + model.on_frame(y, p)
    friction = model.sliding_friction(1, y[V1], model.normal_force(*voltages, p), p)
    slowing = (friction - push) / p[eq.M1]
    return float(y[V1] ** 2 / (2.0 * slowing)) if slowing > 0.0 else math.inf


def step_length(actuator: ActuatorParameters, speed: ArrayLike, voltage: ArrayLike = 0.0) -> Any:
    """Estimate the displacement of the frame by one impact on the right stopper, from momentum.

    A frame at rest leaves an impact of the block at `speed` with v1' = (1 + e) m2/(m1 + m2) speed
    (Equation 5); friction and the load of spring, damper and attraction just after the impact
    decelerate the frame by a_f = (mu_d N - L)/m1 (Equations 1 and 3), so that the frame stops after
    v1'^2/(2 a_f). The estimate neglects changes of load and friction during the slip, and events
    before rest, in particular another impact. Terms contribute their forces just after the impact.

    Parameters
    ----------
    actuator : Actuator
    speed : array_like
        Speed v2 of the block before the impact [m/s], >= 0.
    voltage : array_like, optional
        Voltage at the electrode at the impact [V].

    Returns
    -------
    float or ndarray
        Displacement [m]; infinite if the load overcomes friction.

    Raises
    ------
    InvalidParameter
        If the actuator has terms for which the formula does not hold: compliant stoppers, friction
        without sticking, or forces with memory.

    See Also
    --------
    Run, characteristic

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> f"{mi.step_length(actuator, 0.4):.3e}"
    '2.337e-03'
    """
    speed = numbers_for(actuator, "speed", speed, "m/s")
    voltage = numbers_for(actuator, "voltage", voltage, "V")
    scales, device = actuator.scales, StaticForces(actuator)

    def step(one: float, volts: float) -> float:
        y = device.after_impact(float(scales.into(one, "m/s")))
        inner = coasting(device.model, y, (float(scales.into(volts, "V")), 0.0, 0.0), device.p)
        return float(scales.out(inner, "m"))

    result = np.vectorize(step, otypes=[float])(speed, voltage)
    return float(result) if result.ndim == 0 else result


def step_lengths(run: Any) -> pd.DataFrame:
    """Return the table of `ActuatorRun.step_lengths`."""
    log, period = run.trajectory.events, run.trajectory.period
    rows, steps = frame_steps(log)
    struck = np.zeros(len(log), dtype=bool)
    struck[rows] = True
    hits = log[struck]
    right = hits.guard == RIGHT_IMPACT
    at_rest = right & (hits.before[:, V1] == 0.0)
    chosen = at_rest & (steps > 0.0)
    if not chosen.any():
        problem = _stepless(run, int(right.sum()), int(at_rest.sum()))
        raise InvalidParameter("run", None, "", problem=problem)
    hits, steps = hits[chosen], steps[chosen]
    scales = run.system.units.scales
    volts = run.system.node_voltages(hits.cycle, hits.time, hits.after)["node voltage"]
    volts = scales.out(volts, "V")
    speed = scales.out(hits.before[:, V2], "m/s")
    formula = scales.out(_steps_after(run, hits), "m")
    simulated = scales.out(steps, "m")
    columns = {
        "period": hits.cycle,
        "phase": hits.time / period,
        "v2 before": speed,
        "voltage": volts,
        "step": simulated,
        "formula": formula,
        "ratio": simulated / formula,
    }
    return table({}, run.system, user_columns=columns)


def _stepless(run: Any, right: int, at_rest: int) -> str:
    """Return why the formula applies to no impact of a run."""
    if right == 0:
        return (
            "no impact on the right stopper; raise the voltage (a slow one strikes at "
            f"{contact_amount(run.actuator)}), or start with a kick"
        )
    if at_rest:
        return f"no step of {at_rest} that begin at rest has ended; simulate more periods"
    return (
        f"each of {right} impacts on the right stopper strikes a frame that already slips (for "
        f"{run.measured['share slipping']:.3g} of the time), so that no step ends before the "
        "next; use run.blow_statistics.displacement_per_blow"
    )


def _steps_after(run: Any, hits: Events) -> Floats:
    """Return the formula evaluated at the states after impacts, including those of terms."""
    system = run.system
    if any(term.replaced_rule == "stopper" for term in system.actuator.terms):
        StaticForces(system.actuator).after_impact(0.0)  # raises an error if there is none
    numbers = system.numbers()
    model = compose(system._kinds, system._electrodes)
    times = system.units.scales.out(hits.time, "s")
    rows = zip(hits.after, zip(*system.source_values(times), strict=True), strict=True)
    return np.array([coasting(model, y, each, numbers.parameters) for y, each in rows])
