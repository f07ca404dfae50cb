"""Display of results in notebooks: the table of a result, and its figure below.

Classes of results do not import the modules that draw them. Therefore, when the package is imported
in an IPython session, it registers a formatter for each class by name.
"""

from __future__ import annotations

import base64
import sys
from functools import partial
from importlib import import_module
from io import BytesIO
from typing import Any

from mems_impact.errors import MemsImpactError

DPI = 120  # of a picture

PICTURES = {
    ("analysis.run", "Run"): "plot_run",
    ("analysis.orbit", "Orbit"): "plot_orbit",
    ("analysis.branch", "Branch"): "plot_branch",
    ("analysis.curve", "Curve"): "plot_curve",
    ("actuator.design.operating_chart", "OperatingChart"): "plot_chart",
    ("actuator.design.characteristic", "Characteristic"): "plot_characteristic",
    ("actuator.design.closing", "Closing"): "plot_closing",
    ("actuator.design.energy", "Energy"): "plot_energy",
    ("actuator.design.force_curve", "ForceCurve"): "plot_force_curve",
    ("actuator.design.soft_landing", "SoftLanding"): "plot_closing",
    ("studies.basins", "Basins"): "plot_basins",
    ("studies.operating_map", "OperatingMap"): "plot_map",
    ("studies.optimize", "ParetoFront"): "plot_pareto",
    ("studies.sweep", "Sweep"): "plot_sweep",
    ("studies.uncertainty", "ToleranceAnalysis"): "plot_tolerance_analysis",
}
"""The public function that draws a result of each class, by module and name."""


def register() -> None:
    """Register the formatters of results if this is an IPython session."""
    ipython = sys.modules.get("IPython")
    session = ipython.get_ipython() if ipython is not None else None
    if session is None:
        return
    if hasattr(session, "kernel"):  # a notebook, which shows the figures of pyplot
        from matplotlib import pyplot

        # Loaded within a style, the backend would forget that it is interactive.
        pyplot.switch_backend(pyplot.get_backend())
    formatter = session.display_formatter.formatters["text/html"]
    for (module, name), drawn_by in PICTURES.items():
        show = partial(with_picture, drawn_by=drawn_by)
        formatter.for_type_by_name(f"mems_impact.{module}", name, show)


def with_picture(result: Any, drawn_by: str) -> str:
    """Return the table of a result and its figure as HTML; the table alone if it has no figure.

    `drawn_by` is the name of a public plotting function.
    """
    table: str = result._repr_html_()
    draw = getattr(import_module("mems_impact"), drawn_by)
    try:
        drawn = draw(result)
    except MemsImpactError:  # a run without stored events, an empty branch
        return table
    axes = drawn if hasattr(drawn, "figure") else next(iter(drawn))
    picture = BytesIO()
    axes.figure.savefig(picture, format="png", dpi=DPI)
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close(axes.figure)  # which would show it once more
    data = base64.b64encode(picture.getvalue()).decode("ascii")
    return f'{table}\n<img alt="{drawn_by}" src="data:image/png;base64,{data}">'
