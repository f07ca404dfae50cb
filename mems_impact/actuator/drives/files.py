"""Drives from files: a table ``[drive]`` in TOML, or a measured waveform as CSV."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from os import PathLike
from pathlib import Path
from types import FunctionType
from typing import Any

from mems_impact._util import plugins
from mems_impact._util.files import file_path
from mems_impact.actuator.drives import WAVEFORMS
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.drives.custom import Custom
from mems_impact.actuator.drives.sampled import Sampled
from mems_impact.actuator.terms.files import term_names
from mems_impact.actuator.toml_files import (
    CodeRequest,
    execute_code,
    parse_toml,
    read_bytes,
    resolve_code_path,
)
from mems_impact.errors import InvalidFile, InvalidParameter

SAMPLE_SUFFIXES = (".csv", ".txt", ".dat", ".tsv")
"""Extensions of files with a measured waveform."""

CODE = CodeRequest(
    field="source",
    description="Python file with a function voltage(t, q)",
    kind="drive file",
    reader="load",
)
DRIVE_FILE_REMEDY = (
    'give a TOML file with a table [drive] of lines like kind = "sine", or a CSV file'
)
# What a device file holds.
_BESIDE = ("name", "description", "units", "parameters", "design", "geometry")


def load_drive(path: str | PathLike[str], *, allow_code: bool = False) -> Drive:
    """Load a drive from a TOML or CSV file; see `mems_impact.load`."""
    source = file_path(path, "the path of a TOML or CSV file")
    if source.lower().endswith(SAMPLE_SUFFIXES):
        record = Sampled.from_csv(source)
        try:
            record.check()
        except InvalidParameter as error:
            raise error.located(source) from None
        return record
    raw = read_bytes(source, DRIVE_FILE_REMEDY, kind="drive file")
    content = parse_toml(raw, source, 'a table [drive] of lines like kind = "sine"')
    return drive_in_file(content, source, allow_code)


def drive_in_file(content: Mapping[str, Any], source: str, allow_code: bool) -> Drive:
    """Return the drive of a TOML file."""
    try:
        for name, value in content.items():
            if name not in ("drive", *_BESIDE, *term_names()):
                raise InvalidParameter(name, value, "in the table [drive]")
        if not isinstance(content.get("drive"), dict):
            raise InvalidFile(source, "holds no table [drive]", DRIVE_FILE_REMEDY)
        return drive_in_table(content["drive"], Path(source), allow_code)
    except InvalidParameter as error:
        raise error if error.source else error.located(source) from None


def drive_kinds() -> tuple[str, ...]:
    """Return the kinds of waveforms, plugins last."""
    return plugins.names(plugins.DRIVE_GROUP, WAVEFORMS)


def drive_of_kind(kind: str) -> type[Drive]:
    """Return the waveform of that name; InvalidParameter if there is none."""
    if isinstance(kind, str) and kind in WAVEFORMS:
        module = import_module(f"{__package__}.{kind.replace('-', '_')}")
        drive_type: type[Drive] = getattr(module, WAVEFORMS[kind])
        return drive_type
    plugin_type: type[Drive] | None = None
    if isinstance(kind, str):
        plugin_type = plugins.plugin(plugins.DRIVE_GROUP, kind, _is_drive, "a subclass of Drive")
    if plugin_type is None:
        raise InvalidParameter("kind", kind, f"one of {', '.join(drive_kinds())}")
    return plugin_type


def _is_drive(value: Any) -> bool:
    return isinstance(value, type) and issubclass(value, Drive)


def drive_in_table(table: dict[str, Any], file: Path, allow_code: bool) -> Drive:
    """Return the drive of a table ``[drive]``; paths in it are relative to its file."""
    drive = _drive(table, file, allow_code)
    drive.check()
    return drive


def _drive(table: dict[str, Any], file: Path, allow_code: bool) -> Drive:
    values = dict(table)
    if "kind" not in values:
        allowed = f"one of {', '.join(drive_kinds())}"
        raise InvalidParameter("kind", None, allowed, problem=f"missing, must be {allowed}")
    kind = drive_of_kind(values.pop("kind"))
    if kind is Sampled and "file" in values:
        return _sampled_drive(values, file.parent)
    if kind is Custom:
        code = resolve_code_path(values.pop("source", None), file, allow_code, CODE)
        values["function"] = _function(code)
    for name, field in kind.model_fields.items():
        if field.annotation in (Drive, Drive | None) and isinstance(values.get(name), dict):
            try:
                values[name] = _drive(values[name], file, allow_code)
            except InvalidParameter as error:
                field_name = f"{name}.{error.field}"
                raise InvalidParameter(
                    field_name, error.value, error.allowed, error.source, problem=error.problem
                ) from None
    return kind(**values)


def _sampled_drive(values: dict[str, Any], folder: Path) -> Sampled:
    file = values.pop("file")
    if not isinstance(file, str):
        raise InvalidParameter("file", file, "the path of a CSV file")
    for name in values:
        if name not in ("channel", "period", "phase"):
            allowed = "file, channel, period or phase"
            raise InvalidParameter(name, values[name], allowed, problem=f"must be {allowed}")
    return Sampled.from_csv(folder / file, **values)


def _function(path: Path) -> FunctionType:
    """Run the Python file `path` and return its function of the voltage."""
    function = getattr(execute_code(path, CODE), "voltage", None)
    if not isinstance(function, FunctionType):
        raise InvalidFile(path, "has no function voltage", f"give a {CODE.description}")
    return function
