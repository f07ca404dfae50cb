"""Loading of systems from Python code, and of study files."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

from mems_impact._util import plugins
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.device_files import load_actuator, names_in_file, preset_names
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.drives.files import drive_in_table, drive_of_kind, load_drive
from mems_impact.actuator.parameter_base import unknown
from mems_impact.actuator.state_space import kicked_state
from mems_impact.actuator.toml_files import CodeRequest, execute_code, resolve_code_path
from mems_impact.errors import InvalidFile, InvalidParameter
from mems_impact.systems.base import HybridSystem

# --- Systems in Python code

FORM = (
    'name in Python code, "FILE.py:NAME" or "MODULE:NAME", of a System or of a function that '
    "returns one"
)
SYSTEM_REQUEST = CodeRequest(field="system", description=FORM, kind="command line", reader="load")


def load_system(name: str) -> HybridSystem:
    """Load a system from Python code, or that of a plugin; see `mems_impact.load`."""
    source, colon, attribute = name.rpartition(":") if isinstance(name, str) else ("", "", "")
    if isinstance(name, str) and not colon:
        return _plugin_system(name)
    if not source or not attribute.isidentifier():
        raise InvalidParameter("system", name, f"a {FORM}")
    if source.endswith(".py"):
        path = Path(source)
        if not path.is_file():
            raise InvalidFile(source, "no such file", f"give a {FORM}")
        module = execute_code(path, SYSTEM_REQUEST)
    else:
        module = _imported(source)
    return made_system(getattr(module, attribute, None), source, attribute)


def is_system_name(name: str) -> bool:
    """Return whether a name may denote a system, rather than a device."""
    source, colon, attribute = name.rpartition(":")
    return name in system_names() or bool(colon and source and attribute.isidentifier())


def system_names() -> tuple[str, ...]:
    """Return the names of the systems of plugins."""
    return plugins.names(plugins.SYSTEM_GROUP)


def made_system(value: Any, source: str | PathLike[str], name: str) -> HybridSystem:
    """Return a system, or that returned by a function; InvalidFile if it is not a system."""
    if callable(value) and not isinstance(value, HybridSystem):
        try:
            value = value()
        except Exception as error:
            reason = f"{name}() fails ({type(error).__name__}: {error})"
            raise InvalidFile(source, reason, f"give a {FORM}") from None
    if not isinstance(value, HybridSystem):
        raise InvalidFile(source, f"holds no system {name}", f"give a {FORM}")
    return value


def _plugin_system(name: str) -> HybridSystem:
    system = plugins.plugin(
        plugins.SYSTEM_GROUP, name, _is_system_or_function, "a System or a function"
    )
    if system is None:
        names = ", ".join(system_names())
        raise InvalidParameter("system", name, f"{f'one of {names}, or ' if names else ''}a {FORM}")
    return made_system(system, name, name)


def _is_system_or_function(value: Any) -> bool:
    return isinstance(value, HybridSystem) or callable(value)


def _imported(name: str) -> Any:
    """Import a module, also from the working directory."""
    folder = str(Path.cwd())
    sys.path.insert(0, folder)
    try:
        return import_module(name)
    except (Exception, SystemExit) as error:
        reason = f"cannot be imported ({type(error).__name__}: {error})"
        raise InvalidFile(name, reason, f"give a {FORM}") from None
    finally:
        sys.path.remove(folder)


# --- Study files

KICKED = "kicked"  # value of `initial` for the kicked state
FILE_TABLES = ("name", "description", "device", "system", "set", "drive", "study")
STUDY_FILE_REMEDY = 'give a TOML file with a table [study] of lines like kind = "map"'
STUDY_REQUEST = CodeRequest(
    field="system",
    description=(
        'Python file and a name in it: "FILE.py:NAME", a System or a function that returns one'
    ),
    kind="study file",
    reader="load",
)


@dataclass(frozen=True, kw_only=True)
class StudyFile:
    """A study defined by a file.

    Attributes
    ----------
    path : str
    kind : str
        Kind of the study, such as ``"map"``.
    system : System
    arguments : dict of str to object
        Arguments of the function that runs it, by name.
    """

    path: str
    kind: str
    system: HybridSystem = field(repr=False)
    arguments: dict[str, Any] = field(repr=False)

    def run(self, **changes: Any) -> Any:
        """Run the study and return the result of its function, such as an `OperatingMap`.

        Arguments given here replace arguments in the file: ``workers=8``.
        """
        from mems_impact.studies.engine.config import verb_of

        return verb_of(self.kind)(self.system, **{**self.arguments, **changes})


def study_in_file(content: Mapping[str, Any], source: str, allow_code: bool) -> StudyFile:
    """Return the study of a TOML file; see `mems_impact.load`."""
    try:
        for name in content:
            if name not in FILE_TABLES:
                raise unknown(name, content[name], FILE_TABLES)
        if not isinstance(content["study"], dict):
            raise InvalidFile(source, "holds no table [study]", STUDY_FILE_REMEDY)
        return _Reader(content, Path(source), allow_code).study()
    except InvalidParameter as error:
        raise error if error.source else error.located(source) from None


class _Reader:
    """Reader of the content of a study file."""

    def __init__(self, content: Mapping[str, Any], file: Path, allow_code: bool) -> None:
        self.content, self.file, self.allow_code = content, file, allow_code

    def study(self) -> StudyFile:
        """Return the study."""
        table = dict(self.content["study"])
        kind = table.pop("kind", None)
        start = table.pop("initial", None) if table.get("initial") == KICKED else None
        try:
            # Imported on first use, since it imports all of SciPy's statistics.
            from mems_impact.studies.engine.config import verb_arguments

            arguments = verb_arguments(kind, table, self.file.parent)
        except InvalidParameter as error:
            raise error.located(owner="study") from None
        varied = {name: values[0] for name, values in _varied(arguments)}
        if "system" in self.content:
            system, actuator = self._own_system(), None
        else:
            actuator = self._actuator(varied)
            system = actuator.under(self._drive(varied))
        if start == KICKED:
            if actuator is None:
                allowed = "a table of components of the state: only a device has a kicked state"
                raise InvalidParameter("study.initial", start, allowed)
            arguments["initial"] = kicked_state(actuator)
        return StudyFile(path=str(self.file), kind=kind, system=system, arguments=arguments)

    def _own_system(self) -> HybridSystem:
        for name in ("device", "drive"):
            if name in self.content:
                problem = f"not allowed together with system = {self.content['system']!r}"
                raise InvalidParameter(name, None, "", problem=problem)
        value = self.content["system"]
        if value in system_names():
            return self._changed(load_system(value))
        source, _, name = value.rpartition(":") if isinstance(value, str) else ("", "", "")
        if not source or not name.isidentifier():
            raise InvalidParameter("system", value, f"a {STUDY_REQUEST.description}")
        path = resolve_code_path(source, self.file, self.allow_code, STUDY_REQUEST)
        system = getattr(execute_code(path, STUDY_REQUEST), name, None)
        return self._changed(made_system(system, path, name))

    def _changed(self, system: HybridSystem) -> HybridSystem:
        changes = dict(_flat(self.content.get("set", {}), "set"))
        return system.changed(**changes) if changes else system

    def _actuator(self, varied: Mapping[str, float]) -> Actuator:
        """Return the device, with the terms whose parameters are varied."""
        device = self.content.get("device")
        if not isinstance(device, str):
            allowed = "the name of a preset or the path of a TOML file"
            problem = f"missing, must be {allowed}; or system" if device is None else None
            raise InvalidParameter("device", device, allowed, problem=problem)
        beside = device not in preset_names()
        actuator = load_actuator(self.file.parent / device if beside else device)
        terms = {name: value for name, value in varied.items() if "." in name}
        changes = {**terms, **dict(_flat(self.content.get("set", {}), "set"))}
        return actuator.changed(**changes) if changes else actuator

    def _drive(self, varied: Mapping[str, float]) -> Drive:
        """Return the drive; varied parameters may be absent from its table."""
        table = self.content.get("drive")
        device = str(self.file.parent / self.content["device"])
        if table is None and "drive" in names_in_file(device):
            table = self.content["device"]
        if isinstance(table, str):
            return load_drive(self.file.parent / table, allow_code=self.allow_code)
        if not isinstance(table, dict):
            allowed = "a table of lines like kind = 'sine', or the path of a drive file"
            problem = f"missing, must be {allowed}" if table is None else None
            raise InvalidParameter("drive", table, allowed, problem=problem)
        try:
            if "kind" in table:
                fields = drive_of_kind(table["kind"]).model_fields
                table = {**{name: varied[name] for name in varied if name in fields}, **table}
            return drive_in_table(table, self.file, self.allow_code)
        except InvalidParameter as error:
            raise error if error.source else error.located(owner="drive") from None


def _varied(arguments: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the axes of a study that are parameters."""
    for word in ("x", "y"):
        if word in arguments and len(arguments[word][1]):
            yield arguments[word]


def _flat(table: Any, owner: str) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a table by name, those of nested tables as ``tilt.angle``."""
    if not isinstance(table, dict):
        raise InvalidParameter(owner, table, "a table of lines like e = 0.7")
    for name, value in table.items():
        if isinstance(value, dict):
            yield from ((f"{name}.{inner}", number) for inner, number in _flat(value, owner))
        else:
            yield name, value
