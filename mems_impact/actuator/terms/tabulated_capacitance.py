"""Electrodes with a measured or computed capacitance."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import model_validator

from mems_impact._util.formatting import shown
from mems_impact.actuator.parameter_base import Unit
from mems_impact.actuator.plausible_ranges import CAPACITANCE
from mems_impact.actuator.terms.base import Electrode, ParameterIndices, Shape
from mems_impact.actuator.terms.table import TableNumbers, TableTerm
from mems_impact.errors import InvalidParameter


class TabulatedCapacitance(TableTerm):
    """Electrodes with a capacitance from a table, in place of parallel plates.

    Parameters
    ----------
    positions : tuple of float
        Positions of the block towards the electrode [m], ascending, four or more: x2 for the right
        electrode, -x2 for the left electrode. The table covers the travel from -delta to delta;
        with compliant stoppers up to halfway between stopper and electrode.
    capacitances : tuple of float
        The capacitance at each position [F], > 0, ascending.
    sides : {"both", "right", "left"}, optional
        The electrodes with this capacitance; any other electrode remains a parallel plate.

    Raises
    ------
    InvalidParameter
        If a value is out of range, the columns do not ascend, or their lengths differ; if the table
        does not cover the travel of the block.

    See Also
    --------
    CombDrive, TiltedPlate, TabulatedSpring

    Notes
    -----
    The interpolant is a spline of degree 5 with four continuous derivatives. Where it is not
    monotone, slopes and second derivatives at the adjacent points are limited to make the spline
    monotone, with two continuous derivatives. The force is half the derivative of this spline times
    the square of the voltage, so that the energy balance holds to the tolerance of the integration.

    The spline passes through every point, so its derivative amplifies noise: smooth a noisy
    measurement first. A few points beyond the stoppers make the derivatives there more accurate.
    ``TabulatedCapacitance.from_csv(path, column_units=("um", "fF"))`` reads a file of two columns;
    in a device file, these are the entries ``file`` and ``column_units``.

    `alpha` and `d` do not enter the force of these electrodes; `alpha` determines the units of the
    scaled variables.

    Examples
    --------
    >>> import numpy as np
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> x = np.linspace(-0.5, 0.5, 41)
    >>> plate = mi.TabulatedCapacitance(positions=x, capacitances=2.0 / (1.0 - x))
    >>> f"{mi.pull_in_voltage(actuator):.6f}, {mi.pull_in_voltage(actuator.adding(plate)):.6f}"
    '0.384900, 0.384900'
    """

    capacitances: Annotated[TableNumbers, Unit("F", CAPACITANCE)]
    sides: Literal["both", "right", "left"] = "both"

    column = "capacitances"
    replaced_rule = "electrode"
    plates = False

    @model_validator(mode="after")
    def _check_capacitances(self) -> Self:
        if not self.capacitances[0] > 0.0:
            raise InvalidParameter("capacitances", self.capacitances[0], "> 0")
        for previous, capacitance in pairwise(self.capacitances):
            if not capacitance > previous:
                allowed = f"ascending with the position, above the one before, {shown(previous)}"
                raise InvalidParameter("capacitances", capacitance, allowed)
        return self

    @classmethod
    def electrode(cls, indices: ParameterIndices, shape: Shape, electrode: Electrode) -> Electrode:
        """Return the electrode with the capacitance of the table."""
        spline = cls.spline(indices, shape)
        return electrode._replace(capacitance=spline.value, slope=spline.slope)
