"""Reading and writing of result files, and the identity of systems in them."""

from __future__ import annotations

import hashlib
import json
import zipfile
import zlib
from dataclasses import asdict
from importlib import import_module
from importlib.metadata import version
from os import PathLike, fspath
from typing import Any

import numpy as np

from mems_impact._util.files import replacing
from mems_impact.errors import InvalidFile, InvalidParameter, MemsImpactError
from mems_impact.integrators.cvode.compiled import sundials_version
from mems_impact.integrators.options import Options
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result
from mems_impact.systems.serialization import STORABLE_MODULES
from mems_impact.systems.serialization.codec import CorruptFile, Reader, Writer
from mems_impact.systems.state import State

__all__ = [
    "FILE_FORMAT",
    "check_format",
    "identity",
    "identity_of_options",
    "identity_of_state",
    "load",
    "save",
    "versions",
]

# --- Result files: a zip archive of ``header.json`` and one ``.npy`` per array

# Incremented with every change of the format; no other format is read.
FILE_FORMAT = 4
HEADER = "header.json"
ARRAY = ".npy"
FILE_REMEDY = "give a file written by a result's save(path)"
AGAIN = "save the result again, or get another copy of the file"


def save(value: Result, path: str | PathLike[str]) -> None:
    """Write a result into the file `path`; see `mems_impact.systems.result.Result.save`."""
    _check_path(path)
    register_storables()
    writer = Writer()
    header = {
        "format": FILE_FORMAT,
        "versions": versions(),
        "result": writer.node(value, "result"),
        "tables": {name: writer.node(table, name) for name, table in _kept(value).items()},
    }
    text = json.dumps(header, allow_nan=False)
    with (
        replacing(path) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as file,
    ):
        file.writestr(HEADER, text)
        for name, array in writer.members.items():
            with file.open(name + ARRAY, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


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
    _check_path(path)
    if system is not None and not isinstance(system, HybridSystem):
        allowed = "the System of the result; for an actuator, actuator.under(drive)"
        raise InvalidParameter("system", system, allowed)
    register_storables()
    source = fspath(path)
    header, members = _read(source)
    reader = Reader(members, source, system)
    try:
        value = reader.value(header["result"])
        tables = {name: reader.value(node) for name, node in header["tables"].items()}
    except InvalidParameter as error:
        if error.field == "system":
            raise
        raise InvalidFile(source, f"is damaged ({error})", AGAIN) from None
    except (
        CorruptFile,
        LookupError,
        TypeError,
        ValueError,
        AttributeError,
        RecursionError,
    ) as error:
        raise InvalidFile(source, f"is damaged ({_one_line(error)})", AGAIN) from None
    if not isinstance(value, Result):
        raise InvalidFile(source, "holds no result", FILE_REMEDY)
    if tables and system is None:
        value.attach_saved_tables(tables)
    return value


def versions() -> dict[str, str]:
    """Return the versions of the software that made a result."""
    return {
        "mems_impact": version("mems_impact"),
        "numpy": np.__version__,
        "SUNDIALS": sundials_version(),
    }


def register_storables() -> None:
    """Import the modules that register storable classes."""
    for room in STORABLE_MODULES:
        import_module(room)


def _kept(value: Result) -> dict[str, Any]:
    """Return the attributes that cannot be computed without the system's functions."""
    system = getattr(value, "system", None)
    if system is None or system.is_data_only:
        return {}
    found = {}
    for name in value.kept:
        try:
            found[name] = getattr(value, name)
        except MemsImpactError:  # a run without events has no table of them
            continue
    return found


def _read(source: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return header and arrays of a file."""
    try:
        with zipfile.ZipFile(source) as file:
            names = file.namelist()
            if HEADER not in names:
                raise InvalidFile(source, f"holds no {HEADER}", FILE_REMEDY)
            header = json.loads(file.read(HEADER))
            _check_header(source, header)
            members = {}
            for name in names:
                if name.endswith(ARRAY):
                    with file.open(name) as member:
                        array = np.lib.format.read_array(member, allow_pickle=False)
                    members[name.removesuffix(ARRAY)] = array
            return header, members
    except FileNotFoundError:
        raise InvalidFile(source, "no such file", FILE_REMEDY) from None
    except zipfile.BadZipFile as error:
        reason = f"is not a result file, or is truncated ({_one_line(error)})"
        raise InvalidFile(source, reason, FILE_REMEDY) from None
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InvalidFile(source, f"cannot be read ({reason})", FILE_REMEDY) from None
    except InvalidFile:
        raise
    except (ValueError, EOFError, zlib.error, NotImplementedError, RecursionError) as error:
        raise InvalidFile(source, f"is damaged ({_one_line(error)})", AGAIN) from None


def _check_header(source: str, header: Any) -> None:
    number = header.get("format") if isinstance(header, dict) else None
    if not isinstance(number, int) or not {"result", "tables"} <= header.keys():
        raise InvalidFile(source, "holds no result", FILE_REMEDY)
    made = header.get("versions", {}).get("mems_impact", "of an unknown version")
    check_format(source, number, FILE_FORMAT, made, "save the result again with this version")


def check_format(path: str | PathLike[str], number: int, read: int, made: str, again: str) -> None:
    """Raise InvalidFile for a format that this version does not read.

    Parameters
    ----------
    path : str or os.PathLike
    number, read : int
        The format of the file, and the format that this version reads.
    made : str
        The version of mems_impact that wrote it.
    again : str
        What to do if its format is older.
    """
    if number != read:
        reason = f"has format {number} (mems_impact {made}); this version reads format {read}"
        raise InvalidFile(path, reason, "update mems_impact" if number > read else again)


def _check_path(path: Any) -> None:
    if not isinstance(path, str | PathLike) or isinstance(fspath(path), bytes):
        raise InvalidParameter("path", path, "the path of a file")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


# --- Identity of systems, states and options


def identity(system: HybridSystem) -> dict[str, Any]:
    """Return the identity of a system: its description, and a digest of its functions."""
    from mems_impact.integrators.jit.closures import digest  # which imports numba

    register_storables()
    writer = Writer()
    node = writer.node(system, "system")
    arrays = {
        name: hashlib.sha256(array.tobytes()).hexdigest() for name, array in writer.members.items()
    }
    automaton = system.automaton
    functions = [automaton.flow, automaton.margins, automaton.transition]
    functions += [each.function for each in system.study_observables]
    return {"system": node, "arrays": arrays, "functions": digest(*functions)}


def identity_of_state(state: State | None) -> dict[str, Any] | None:
    """Return the identity of a state; None for the initial state of the system."""
    if state is None:
        return None
    return {**state.as_dict(), "time": state.time, "mode": state.mode}


def identity_of_options(options: Options) -> dict[str, Any]:
    """Return the identity of options."""
    return asdict(options)
