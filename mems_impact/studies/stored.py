"""The results of studies that may be in a file."""

from mems_impact.analysis.storing.coding import register
from mems_impact.studies.axes import Axis
from mems_impact.studies.basins import Basins
from mems_impact.studies.following import AttractorBranches
from mems_impact.studies.operating_map import OperatingMap
from mems_impact.studies.optimize import Optimum
from mems_impact.studies.pareto import ParetoFront
from mems_impact.studies.scatter import Scatter
from mems_impact.studies.sensitivity import Sensitivity
from mems_impact.studies.starts import Grid, Sample

__all__: list[str] = []

register(Axis)
register(Grid)
register(Sample)
register(OperatingMap)
register(Basins)
register(AttractorBranches)
register(Scatter)
register(Optimum)
register(ParetoFront)
register(Sensitivity)
