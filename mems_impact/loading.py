"""Loading of results, stores, systems, devices, drives and studies by what a file holds."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any

from mems_impact._util.files import file_path, opened
from mems_impact.errors import InvalidFile, InvalidParameter
from mems_impact.systems.base import HybridSystem

REMEDY = (
    "give a saved result, the directory of a study, a TOML file with a table [parameters], "
    "[design], [drive] or [study], a waveform as CSV, or a system as FILE.py:NAME"
)


def load(
    path: str | PathLike[str], *, system: HybridSystem | None = None, allow_code: bool = False
) -> Any:
    """Load a result, a study, a device, a drive or a system.

    Parameters
    ----------
    path : str or os.PathLike
        One of:

        - a result's file, written by its ``save(path)``
        - the directory given as ``store`` to a study, at any time
        - a TOML file with a table ``[study]``: its ``kind``, and the arguments of the verb by their
          names in Python. Above it ``device``, a preset or the file of a device, with a table
          ``[drive]`` (or ``drive``, a drive file; or none, where the file of the device has such a
          table) and changes of parameters in a table ``[set]``; or ``system = "FILE.py:NAME"``
        - a TOML file of a device, as `load_actuator` takes it; with a table ``[drive]`` it gives
          the device under the drive
        - a TOML file with a table ``[drive]`` alone, with the ``kind`` and the parameters of the
          waveform (``frequency`` [Hz] may replace ``omega``); a nested waveform is a nested table
          (``[drive.wave]`` of a burst, ``[drive.right]`` and ``[drive.left]``). A sampled waveform
          takes ``file``, a custom one ``source``
        - a CSV file, as `Sampled.from_csv` takes it
        - ``"FILE.py:NAME"`` or ``"MODULE:NAME"``: the name in a file, or in a module that can be
          imported from the working directory or is installed, of a `System` or of a function
          without arguments that makes one; the code is executed. Or the name of a system of a
          plugin, registered by an entry point of the group ``mems_impact.systems``

        Paths in a file are relative to the file.
    system : System, optional
        For a saved result, the system with the same states, modes, guards and parameters; the
        values of parameters are taken from the file. A system that numbers define completely, such
        as an actuator under one of the package's waveforms, needs none. For a system with your own
        functions the file holds only a description: without `system`, the result provides the saved
        tables, and other operations raise `FunctionsMissing`; with `system`, it can be sampled,
        verified and continued like the original. For an actuator, ``actuator.under(drive)``.
    allow_code : bool, optional
        Whether Python code that a TOML file names may be executed, with your permissions. Allow it
        for files whose code you have read. The code must lie in the folder of the TOML file or
        below, links followed. No code in a saved result, or named by it, is run.

    Returns
    -------
    Run, Orbit, Branch, Curve, Basins, …
        From a saved result.
    StoredStudy
        From the directory of a study.
    StudyFile
        From a study file: ``load(path).run()`` runs the study.
    Actuator, Drive or System
        Otherwise.

    Raises
    ------
    InvalidFile
        If the file cannot be read, holds nothing of these, is damaged or has another format; if it
        names code without `allow_code`, or outside its folder; if the code fails.
    InvalidParameter
        If a TOML file holds a wrong, missing or unknown entry, or `system` does not match the
        result.

    See Also
    --------
    load_actuator, Run, Drive, System, FunctionsMissing, StoredStudy

    Examples
    --------
    >>> from pathlib import Path
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> run = mi.simulate(actuator, mi.Sine(amplitude=0.24, omega=0.5), periods=300)
    >>> run.save("run.zip")
    >>> mi.load("run.zip").impacts.equals(run.impacts)
    True

    A drive, and a study:

    >>> _ = Path("wave.toml").write_text('''
    ... [drive]
    ... kind = "sine"
    ... amplitude = 0.24
    ... omega = 0.5
    ... ''')
    >>> mi.load("wave.toml").amplitude
    0.24
    >>> _ = Path("map.toml").write_text('''
    ... device = "zhao2004"
    ... [drive]
    ... kind = "sine"
    ... [study]
    ... kind = "map"
    ... x = ["amplitude", 0.22, 0.24, 2]
    ... y = ["omega", [0.5]]
    ... initial = "kicked"
    ... ''')
    >>> mi.load("map.toml").run().table["motion"].tolist()
    ['periodic', 'periodic']
    """
    source = file_path(path)
    reader = _reader(source, allow_code)
    if reader is None:
        from mems_impact.systems.serialization.file import load_result

        return load_result(source, system=system)
    if system is not None:
        raise InvalidParameter("system", system, "omitted, since the file is no saved result")
    return reader()


def _reader(source: str, allow_code: bool) -> Callable[[], Any] | None:
    """Return the function that loads a source; None for a saved result."""
    if Path(source).is_dir():
        from mems_impact.studies.engine.store import read_study

        return lambda: read_study(source)
    if not Path(source).exists():
        from mems_impact.actuator.device_files import preset_names
        from mems_impact.actuator.system_files import is_system_name, load_system

        if is_system_name(source):
            return lambda: load_system(source)
        if source in preset_names():
            remedy = f"mi.load_actuator({source!r}) loads it"
            raise InvalidFile(source, "no such file, but a preset", remedy)
    with opened(source, REMEDY) as file:
        if source.lower().endswith(".zip") or file.read(2) == b"PK":  # as ZIP archives begin
            return None
    return _text_reader(source, allow_code)


def _text_reader(source: str, allow_code: bool) -> Callable[[], Any]:
    from mems_impact.actuator.device_files import actuator_in_file
    from mems_impact.actuator.drives.files import SAMPLE_SUFFIXES, drive_in_file, load_drive
    from mems_impact.actuator.system_files import study_in_file
    from mems_impact.actuator.toml_files import parse_toml, read_bytes

    if source.lower().endswith(SAMPLE_SUFFIXES):
        return lambda: load_drive(source)
    raw = read_bytes(source, REMEDY, kind="TOML file")
    content = parse_toml(raw, source, REMEDY)
    if "study" in content:
        return lambda: study_in_file(content, source, allow_code)
    drive = "drive" in content
    if not content.keys() & {"parameters", "design"}:
        if not drive:
            raise InvalidFile(source, "holds none of the tables that can be loaded", REMEDY)
        return lambda: drive_in_file(content, source, allow_code)
    if not drive:
        return lambda: actuator_in_file(content, source)
    return lambda: actuator_in_file(content, source).under(
        drive_in_file(content, source, allow_code)
    )
