"""Serialization of results of studies."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import pandas as pd

from mems_impact.studies.attractor_continuation import AttractorBranches
from mems_impact.studies.basins import Basins
from mems_impact.studies.bifurcation_diagram import BifurcationDiagram
from mems_impact.studies.fit import Fit
from mems_impact.studies.operating_map import OperatingMap
from mems_impact.studies.optimize import Optimum, ParetoFront
from mems_impact.studies.sampling import Axis, Grid, Sample
from mems_impact.studies.sensitivity import Sensitivity
from mems_impact.studies.sweep import Sweep
from mems_impact.studies.uncertainty import ToleranceAnalysis
from mems_impact.systems.serialization.codec import register

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


def _fit_parts(fit: Fit) -> dict[str, Any]:
    """Return the parts of a fit without its runs."""
    parts = {each.name: getattr(fit, each.name) for each in fields(fit) if each.compare}
    return {**parts, "noise": fit.noise.to_dict()}


def _fit(*, noise: dict[str, float], covariance: pd.DataFrame, **parts: Any) -> Fit:
    covariance.index = covariance.columns
    return Fit(noise=pd.Series(noise, dtype=float), covariance=covariance, **parts)


register(Fit, parts=_fit_parts, constructor=_fit)
