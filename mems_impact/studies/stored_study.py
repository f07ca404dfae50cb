"""What stands in the store of a study, read at any time: while it runs, too."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

from mems_impact.analysis.values import Summarized
from mems_impact.errors import InvalidParameter
from mems_impact.studies import parquet
from mems_impact.studies.frames import frame
from mems_impact.studies.layout import Chunk
from mems_impact.studies.store import chunks_of, manifest_of, path_of

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["FIGURES", "StoredStudy", "read_study"]

FIGURES = {
    "basins": "mems_impact.plotting.basins:plot_basins",
    "operating_map": "mems_impact.plotting.map:plot_map",
    "scatter": "mems_impact.plotting.scatter:plot_scatter",
    "sweep": "mems_impact.plotting.sweep:plot_sweep",
}
"""Who draws what is stored of a kind of study, ``module:function``: of a StoredStudy, to axes."""


@dataclass(frozen=True, eq=False)
class StoredStudy(Summarized):
    """What a store held when it was read.

    Attributes
    ----------
    path : str
    kind : str
        The verb of the study, such as ``"sweep"``.
    done, total : int
        Number of points that are done, and of all.
    failed : int
        Those that are done, but have no numbers.
    identity : dict
        What the numbers depend on: system, values, options, seeds.
    attrs : dict
        Of its table: units, versions.

    See Also
    --------
    read_study, load_study

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> table = mi.sweep(
    ...     actuator, drive, "amplitude", [0.2, 0.24], transient=50, periods=5, store="out/sweep"
    ... )
    >>> study = mi.read_study("out/sweep")
    >>> study.failed, len(study.table)
    (0, 10)
    """

    path: str
    kind: str
    done: int
    total: int
    failed: int
    identity: Mapping[str, Any]
    attrs: Mapping[str, Any]
    _schema: Mapping[str, str]
    _parts: tuple[Chunk, ...]

    @cached_property
    def table(self) -> pd.DataFrame:
        """The rows of the points that are done, in their order.

        Raises
        ------
        InvalidFile
            If a file of the store is damaged.
        """
        directory = Path(self.path)
        files = [path_of(directory, part) for part in self._parts]
        chunks = [parquet.columns(file, self._schema) for file in files]
        return frame(chunks, self._schema, self.attrs)

    def summary(self) -> dict[str, Any]:
        """Return how far the study is."""
        return {name: getattr(self, name) for name in ("path", "kind", "done", "total", "failed")}

    @property
    def figure(self) -> str:
        """Who draws it; nobody of a kind that has no figure."""
        return FIGURES.get(self.kind, "")

    def draw(self) -> Any:
        """Draw the points that are done; return the axes.

        Raises
        ------
        InvalidParameter
            If there is no figure of its kind.
        """
        if not self.figure:
            raise InvalidParameter("kind", self.kind, f"one of {', '.join(FIGURES)}, to be drawn")
        return resolve_name(self.figure)(self)

    def __repr__(self) -> str:
        return f"StoredStudy({self.kind}, {self.done} of {self.total} points, {self.path!r})"


def read_study(path: str | os.PathLike[str]) -> StoredStudy:
    """Read what is done of a study from its store, be it finished, running or broken off.

    Parameters
    ----------
    path : str or os.PathLike
        The directory that was given as ``store``.

    Returns
    -------
    StoredStudy

    Raises
    ------
    InvalidFile
        If there is no study.
    InvalidParameter
        If pyarrow is not installed.

    See Also
    --------
    StoredStudy, load_study, operating_map

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> table = mi.sweep(
    ...     actuator, drive, "amplitude", [0.2, 0.24], transient=50, periods=5, store="out/sweep"
    ... )
    >>> study = mi.read_study("out/sweep")
    >>> study.kind, study.done, study.total
    ('sweep', 2, 2)
    >>> study.table.equals(table)
    True
    """
    parquet.check()
    directory = Path(path)
    manifest = manifest_of(directory)
    found = {part: parquet.footer(path_of(directory, part)) for part in chunks_of(manifest)}
    kept = {part: told for part, told in found.items() if told is not None}
    return StoredStudy(
        path=os.fspath(path),
        kind=manifest["kind"],
        done=sum(part.points for part in kept),
        total=manifest["points"],
        failed=sum(told["failed"] for told in kept.values()),
        identity=manifest["identity"],
        attrs=manifest["attrs"],
        _schema=manifest["schema"],
        _parts=tuple(kept),
    )
