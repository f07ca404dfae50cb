"""`simulate` and `find_orbit` as devices have them: `overloads.pyi` tells editors their results.

The functions are those of `analysis`, which knows nothing of actuators. Nothing of the actuator is
imported here, so that a run of another system loads none of it.
"""

from mems_impact.analysis.orbit import find_orbit
from mems_impact.analysis.simulate import simulate

__all__ = ["find_orbit", "simulate"]
