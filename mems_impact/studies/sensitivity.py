"""How the numbers of an orbit move with the parameters, and how they scatter with tolerances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.quantity import Quantity
from mems_impact.analysis.special import check_kind
from mems_impact.analysis.system import System
from mems_impact.analysis.values import Value
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.trajectory import Floats
from mems_impact.studies.derivatives import chosen_quantities, derivatives
from mems_impact.studies.tolerance import deviations

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Sensitivity", "scatter", "sensitivity"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivity(Value):
    """The derivatives of an orbit's quantities by its parameters, in the units of the system.

    Attributes
    ----------
    orbit : Orbit
    quantities, parameters : tuple of str
    units : tuple of str
        Of the quantities; empty for pure numbers.
    values : float array, shape (quantities,)
    derivatives : float array, shape (quantities, parameters)

    See Also
    --------
    sensitivity, plot_sensitivity, margins

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> found = mi.sensitivity(orbit)
    >>> "mean speed" in found.quantities, "omega" in found.parameters
    (True, True)
    >>> float(found.gradient("mean speed")["mu_s"])  # each blow tears the frame off
    0.0
    """

    orbit: Orbit = field(repr=False)
    quantities: tuple[str, ...]
    parameters: tuple[str, ...]
    units: tuple[str, ...] = field(repr=False)
    values: Floats = field(repr=False)
    derivatives: Floats = field(repr=False)

    @property
    def system(self) -> System:
        """The orbit's."""
        return self.orbit.system

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row a quantity and parameter.

        Columns: quantity, value, parameter, at (value of the parameter), derivative, elasticity
        (per cent of change of the quantity for one of the parameter) and per cent (by how much the
        quantity changes then); unit (of the quantity) where there are units.
        """
        import pandas as pd

        q, p = len(self.quantities), len(self.parameters)
        at = np.array([self.system.value(name) for name in self.parameters])
        with np.errstate(divide="ignore", invalid="ignore"):
            elasticity = self.derivatives * at / self.values[:, None] + 0.0
        columns = {
            "quantity": np.repeat(self.quantities, p),
            "value": np.repeat(self.values, p),
            "parameter": np.tile(self.parameters, q),
            "at": np.tile(at, q),
            "derivative": self.derivatives.ravel(),
            "elasticity": elasticity.ravel(),
            "per cent": (0.01 * self.derivatives * at).ravel(),
        }
        if self.system.units:
            columns["unit"] = np.repeat(self.units, p)
        found = pd.DataFrame(columns)
        found.attrs = {"system": repr(self.system)}
        return found

    def gradient(self, quantity: str) -> pd.Series:
        """Return the derivatives of a quantity, by parameter.

        Raises
        ------
        InvalidParameter
            If there is no such quantity.
        """
        import pandas as pd

        row = self.row(quantity)
        return pd.Series(self.derivatives[row], index=list(self.parameters), name=quantity)

    def row(self, quantity: str) -> int:
        """Return the row of a quantity among `values`; raises InvalidParameter if there is none."""
        if quantity not in self.quantities:
            raise InvalidParameter("quantity", quantity, f"one of {', '.join(self.quantities)}")
        return self.quantities.index(quantity)

    def scatter(self, tolerances: Mapping[str, float | str]) -> pd.DataFrame:
        """Return how the quantities scatter with independent parameters, to first order.

        The variance is the sum of (dq/dp sigma)^2.

        Parameters
        ----------
        tolerances : mapping of str to float
            Standard deviations of parameters, in their units, or as a part: ``"5%"``.

        Returns
        -------
        DataFrame
            One row a quantity: quantity, value, standard deviation, relative (to the value), and
            one column a parameter, its share of the variance.

        Raises
        ------
        InvalidParameter
            If a name is none of `parameters`, or a deviation is below 0.

        Examples
        --------
        >>> found = mi.sensitivity(orbit)
        >>> found.scatter({"delta": 0.01, "mu_d": 0.02})
        """
        import pandas as pd

        sizes = deviations(tolerances, self.system, self.parameters)
        places = [self.parameters.index(name) for name in sizes]
        parts = (self.derivatives[:, places] * np.array(list(sizes.values()))) ** 2
        deviation = scatter(self.derivatives[:, places], sizes)
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = parts / parts.sum(axis=1, keepdims=True)
            relative = deviation / np.abs(self.values)
        columns = {"standard deviation": deviation, "relative": relative}
        columns |= {f"share {name}": shares[:, i] for i, name in enumerate(tolerances)}
        found = pd.DataFrame({"quantity": self.quantities, "value": self.values, **columns})
        found.attrs = {"system": repr(self.system)}
        return found

    def summary(self) -> dict[str, Any]:
        """Return the value of each quantity, and which parameter moves it most."""
        table = self.table
        told: dict[str, Any] = {"system": repr(self.system)}
        for name, unit in zip(self.quantities, self.units, strict=True):
            rows = table[table["quantity"] == name].dropna(subset=["per cent"])
            if len(rows):
                most = rows.loc[rows["per cent"].abs().idxmax()]
                told[self.system.scales.label(name, unit)] = (
                    f"{most['value']:.6g}; {most['parameter']} + 1 %: {most['per cent']:+.3g}"
                )
        return told


def sensitivity(
    orbit: Orbit,
    parameters: Sequence[str] | None = None,
    quantities: Sequence[str | Quantity] | None = None,
) -> Sensitivity:
    """Return the derivatives of an orbit's quantities by its parameters.

    The orbit may be unstable. Derivatives of its states, event times, margins and speeds follow
    from the variational equations along its arcs and the implicit function theorem; those of
    `Quantity` functions by the chain rule. Multipliers, which are derivatives already, are
    differentiated along orbits that are corrected beside it.

    Parameters
    ----------
    orbit : Orbit
    parameters : sequence of str, optional
        All by default, but the bias of a symmetric voltage: its period doubles there.
    quantities : sequence of str or Quantity, optional
        All that the system knows by default, but costly ones. Of any system: "x per period" (or
        "per cycle") for each cyclic state x, its observables (over the orbit), "period" of a limit
        cycle, "impact speed" (the largest), "closest approach", "largest multiplier" (its
        modulus). Of an actuator: "displacement per period", "mean speed", "displacement per
        impact", "impact speed", "closest approach", "energy lost per period" (in impacts),
        "largest multiplier", and "energy given per period", which is costly.

    Returns
    -------
    Sensitivity

    Raises
    ------
    InvalidParameter
        If there is no such parameter or quantity.
    OrbitError
        If the orbit stands at a fold, or none is found beside it.

    See Also
    --------
    Sensitivity, optimize, margins, scatter

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> found = mi.sensitivity(orbit)
    >>> f"{found.gradient('mean speed')['omega']:.5e}"
    '1.82824e-03'
    """
    check_kind(orbit, "orbit", Orbit, "an Orbit, from find_orbit")
    system = orbit.system
    names = _all_parameters(system) if parameters is None else tuple(parameters)
    for name in names:
        system.check_continued(name)
    if not names or len(set(names)) != len(names):
        raise InvalidParameter("parameters", names, "one or more different parameters")
    chosen = chosen_quantities(system, quantities)
    values, found = derivatives(orbit, chosen, names)
    return Sensitivity(
        orbit=orbit,
        quantities=tuple(each.name for each in chosen),
        parameters=names,
        units=tuple(each.unit for each in chosen),
        values=values,
        derivatives=found,
    )


def scatter(gradients: Floats, tolerances: Mapping[str, float]) -> Floats:
    """Return standard deviations to first order; the last axis of `gradients` is the parameters."""
    return np.asarray(np.sqrt(((gradients * np.array(list(tolerances.values()))) ** 2).sum(-1)))


def _all_parameters(system: System) -> tuple[str, ...]:
    names = []
    for name in system.parameters:
        try:
            system.check_continued(name)
        except InvalidParameter:
            continue  # the bias of a voltage without one
        names.append(name)
    return tuple(names)
