"""The results of studies that may be in a file."""

from mems_impact.analysis.storing.coding import register
from mems_impact.studies.optimize import Optimum
from mems_impact.studies.pareto import ParetoFront
from mems_impact.studies.sensitivity import Sensitivity

__all__: list[str] = []

register(Optimum)
register(ParetoFront)
register(Sensitivity)
