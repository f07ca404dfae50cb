"""Result files, and the identity of a system in them."""

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

# --- The file of a result: a zip file of ``header.json`` and one ``.npy`` an array.

# Raised by every change of what is written; no other format is read.
FILE_FORMAT = 4
HEADER = "header.json"
ARRAY = ".npy"
FILE_REMEDY = "give a file that a result's save(path) wrote"
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
    """Load a result from the file that its ``save(path)`` wrote.

    No code is run that the file might hold or name. What is made of numbers, such as an actuator
    under one of the package's waveforms, comes back whole. A system of your own functions is only
    described: without it the result shows and tabulates what was saved, and says what it cannot
    do; give the system, and it is sampled, verified and continued as the one that was saved.

    Parameters
    ----------
    path : str or os.PathLike
    system : System, optional
        The system of the result, with the same states, modes, guards and parameters; their values
        are those of the file. Of an actuator, ``actuator.under(drive)``.

    Returns
    -------
    Run, Orbit, Branch, SpecialPoint, Curve, OperatingChart, Verification or System

    Raises
    ------
    InvalidFile
        If the file cannot be read, is none that was saved, is damaged, or of another format.
    InvalidParameter
        If `system` is not that of the file.

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
        allowed = "the System of the result; of an actuator, actuator.under(drive)"
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
    """Return the versions of what made a result."""
    return {
        "mems_impact": version("mems_impact"),
        "numpy": np.__version__,
        "SUNDIALS": sundials_version(),
    }


def register_storables() -> None:
    """Let every room say what of it may stand in a file."""
    for room in STORABLE_MODULES:
        import_module(room)


def _kept(value: Result) -> dict[str, Any]:
    """Return what could not be made again without the functions of the result's system."""
    system = getattr(value, "system", None)
    if system is None or system.is_data_only:
        return {}
    found = {}
    for name in value.kept:
        try:
            found[name] = getattr(value, name)
        except MemsImpactError:  # a run that kept no events has no table of them
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
        reason = f"is no result, or is cut short ({_one_line(error)})"
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
    """Refuse what another version wrote in a format that this one does not read.

    Parameters
    ----------
    path : str or os.PathLike
    number, read : int
        The format that the file is of, and the one that is read.
    made : str
        The version of mems_impact that wrote it.
    again : str
        What to do if its format is older.
    """
    if number != read:
        reason = f"is of format {number} (mems_impact {made}); this version reads format {read}"
        raise InvalidFile(path, reason, "update mems_impact" if number > read else again)


def _check_path(path: Any) -> None:
    if not isinstance(path, str | PathLike) or isinstance(fspath(path), bytes):
        raise InvalidParameter("path", path, "the path of a file")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


# --- What a system is, as JSON: equal for two systems whose numbers are the same.


def identity(system: HybridSystem) -> dict[str, Any]:
    """Return what tells a system from others: as files tell it, and a digest of its functions."""
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
    """Return what tells a state from others; None for a system's own start."""
    if state is None:
        return None
    return {**state.as_dict(), "time": state.time, "mode": state.mode}


def identity_of_options(options: Options) -> dict[str, Any]:
    """Return what tells options from others."""
    return asdict(options)
