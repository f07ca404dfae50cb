"""Serialization of results of studies."""

from mems_impact.studies.attractor_continuation import AttractorBranches
from mems_impact.studies.basins import Basins
from mems_impact.studies.bifurcation_diagram import BifurcationDiagram
from mems_impact.studies.operating_map import OperatingMap
from mems_impact.studies.optimize import Optimum, ParetoFront
from mems_impact.studies.sampling import Axis, Grid, Sample
from mems_impact.studies.sensitivity import Sensitivity
from mems_impact.studies.sweep import Sweep
from mems_impact.studies.uncertainty import ToleranceAnalysis
from mems_impact.systems.serialization.codec import register

__all__: list[str] = []

register(Axis)
register(Grid)
register(Sample)
register(OperatingMap)
register(Sweep)
register(Basins)
register(AttractorBranches)
register(BifurcationDiagram)
register(ToleranceAnalysis)
register(Optimum)
register(ParetoFront)
register(Sensitivity)
