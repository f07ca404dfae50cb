"""A voltage that rises evenly and falls at once."""

import numpy as np

from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.parameter_base import NonNegative, Positive


def _voltage(t, q):
    return q[0] * (t / q[1] - np.floor(t / q[1]))


class Sawtooth(Drive):
    amplitude: NonNegative
    period: Positive

    units = {"amplitude": "V", "period": "s"}  # noqa: RUF012

    voltage = staticmethod(_voltage)

    @property
    def switches(self):
        return (self.period,)

    def parameters(self):
        return np.array([self.amplitude, self.period])
