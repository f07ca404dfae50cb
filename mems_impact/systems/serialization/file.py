"""Loading of results from files."""

from __future__ import annotations

import zipfile
from os import PathLike
from typing import Any

from mems_impact._util.files import file_path, opened
from mems_impact.errors import InvalidFile, InvalidParameter
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result
from mems_impact.systems.serialization.archive import (
    DAMAGE_REMEDY,
    FILE_REMEDY,
    read_archive,
    register_storables,
    text_of_error,
)
from mems_impact.systems.serialization.codec import Reader

__all__ = ["load"]


def load(path: str | PathLike[str], *, system: HybridSystem | None = None) -> Any:
    """Load a result from a file written by its ``save(path)``.

    No code in the file, or named by it, is run. A system that numbers define completely, such as an
    actuator under one of the package's waveforms, is restored completely. For a system with your
    own functions the file holds only a description: without `system`, the result provides the saved
    tables, and other operations raise `FunctionsMissing`; with `system`, it can be sampled,
    verified and continued like the original.

    Parameters
    ----------
    path : str or os.PathLike
    system : System, optional
        The system of the result, with the same states, modes, guards and parameters; the values of
        parameters are taken from the file. For an actuator, ``actuator.under(drive)``.

    Returns
    -------
    Run, Orbit, Branch, SpecialPoint, Curve, OperatingChart, Verification or System

    Raises
    ------
    InvalidFile
        If the file cannot be read, is not a result file, is damaged, or has another format.
    InvalidParameter
        If `system` does not match the file.

    See Also
    --------
    Run, Branch, Orbit, FunctionsMissing

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=300)
    >>> run.save("run.zip")
    >>> again = mi.load("run.zip")
    >>> again.impacts.equals(run.impacts)
    True
    """
    if system is not None and not isinstance(system, HybridSystem):
        allowed = "the System of the result; for an actuator, actuator.under(drive)"
        raise InvalidParameter("system", system, allowed)
    register_storables()
    source = file_path(path)
    try:
        with opened(source, FILE_REMEDY) as raw:
            header, members = read_archive(source, raw)
        reader = Reader(members, source, system)
        value = reader.value(header["result"])
        if not isinstance(value, Result):
            raise InvalidFile(source, "holds no result", FILE_REMEDY)
        tables = {name: reader.value(node) for name, node in header["tables"].items()}
    except InvalidFile:
        raise
    except zipfile.BadZipFile as error:
        reason = f"is not a result file, or is truncated ({text_of_error(error)})"
        raise InvalidFile(source, reason, FILE_REMEDY) from None
    except Exception as error:  # content that `save` does not write may raise any exception
        if isinstance(error, InvalidParameter) and error.field == "system":
            raise
        reason = f"is damaged ({text_of_error(error)})"
        raise InvalidFile(source, reason, DAMAGE_REMEDY) from error
    if tables and system is None:
        value.attach_saved_tables(tables)
    return value
