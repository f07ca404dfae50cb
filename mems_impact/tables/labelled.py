"""Tables as labelled arrays, with their units.

pandas has `DataFrame.to_xarray` for that, which knows nothing of ``table.attrs``: units and
provenance would be lost, and rows be numbered instead of told by time. A subclass of DataFrame that
does better would come back from every operation of pandas; so this is a function.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING

import pandas as pd

from mems_impact.errors import InvalidParameter

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["to_xarray"]

TIME = "t"


def to_xarray(table: pd.DataFrame, index: str | Sequence[str] | None = None) -> xr.Dataset:
    """Return a table as labelled arrays: ``dataset["x2"].attrs["units"]`` is its unit.

    Parameters
    ----------
    table : DataFrame
        One of this package, such as ``run.samples()`` or ``found.table`` of a map.
    index : str or sequence of str, optional
        The columns that tell rows apart, which become coordinates: several make a grid, such as
        ``("omega", "amplitude")`` of a map. By default the running time ``t`` if the table has it,
        else the number of the row.

    Returns
    -------
    xarray.Dataset
        One variable a column, with ``units`` in its ``attrs``; in the ``attrs`` of the dataset what
        else the table tells of itself (``system``, version).

    Raises
    ------
    InvalidParameter
        If xarray is not installed, a column is not in the table, or two rows have the same
        coordinates of a grid.

    See Also
    --------
    Run, operating_map

    Examples
    --------
    >>> import mems_impact as mi
    >>> run = mi.simulate(mi.load_actuator("mita2003"), mi.Sine(amplitude=20.0, omega=900.0), 5)
    >>> mi.to_xarray(run.samples(per_period=100))["x2"].attrs["units"]
    'm'
    """
    if not isinstance(table, pd.DataFrame):
        raise InvalidParameter("table", type(table).__name__, "a DataFrame")
    if find_spec("xarray") is None:
        problem = "needs xarray, which is not installed: pip install 'mems-impact[xarray]'"
        raise InvalidParameter("to_xarray", None, "", problem=problem)
    import xarray as xr

    names = [index] if isinstance(index, str) else list(index or ())
    if not names and TIME in table:
        names = [TIME]
    for column in names:
        if column not in table:
            raise InvalidParameter("index", column, f"one of {', '.join(map(str, table.columns))}")
    rows = table.set_index(names) if names else table.rename_axis("row")
    if len(names) > 1 and rows.index.has_duplicates:
        raise InvalidParameter("index", tuple(names), "columns by which no two rows are the same")
    dataset = xr.Dataset.from_dataframe(rows)
    units = table.attrs.get("units", {})
    for name in dataset.variables:
        if name in units:
            dataset[name].attrs["units"] = units[name]
    told = {name: value for name, value in table.attrs.items() if name != "units"}
    dataset.attrs.update({name: str(value) for name, value in told.items()})
    return dataset
