"""Impact microactuators, and other systems that switch between smooth modes."""

from mems_impact.actuator.drive import Sine
from mems_impact.actuator.parameters import Actuator, load_actuator
from mems_impact.cvode.options import Options

__all__ = ["Actuator", "Options", "Sine", "load_actuator"]
