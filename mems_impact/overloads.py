"""`simulate` and `find_orbit` with overloads for devices, which `overloads.pyi` gives to editors.

The functions are those of `analysis`. The types of devices are in the stub alone, so that runs of
other systems do not import them.
"""

from mems_impact.analysis.orbit import find_orbit
from mems_impact.analysis.simulate import simulate

__all__ = ["find_orbit", "simulate"]
