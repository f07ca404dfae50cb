"""Devices in TOML files."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from mems_impact._util.files import file_path
from mems_impact._util.formatting import stem
from mems_impact._util.warning_scopes import warn
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.geometry.geometry import Geometry
from mems_impact.actuator.parameter_base import Checked, unknown
from mems_impact.actuator.parameters import PARAMETER_NAMES
from mems_impact.actuator.plausibility import check_plausible_device
from mems_impact.actuator.terms.files import term_names, term_of
from mems_impact.actuator.toml_files import parse_toml, read_bytes
from mems_impact.errors import InvalidFile, InvalidParameter, UnitsWarning

_DEVICES = files("mems_impact.actuator") / "devices"
MAX_DEVICE_FILE_BYTES = (
    1_000_000  # bytes; far above any device file, far below what fills the memory
)
_LIGHT = 1e-3  # masses below: kilograms of a device in SI; scaled ones are of the order of 1


class _DeviceFile(Checked):
    """Top-level content of a device file."""

    name: str = ""
    description: str = ""
    units: Literal["dimensionless", "SI"] = "dimensionless"
    parameters: dict[str, Any] = Field(default={})
    design: dict[str, Any] = Field(default={})
    geometry: dict[str, Any] | None = None
    drive: dict[str, Any] | None = None  # for `mems_impact.actuator.drives.files.load_drive`

    @model_validator(mode="before")
    @classmethod
    def _check_table(cls, content: dict[str, Any]) -> dict[str, Any]:
        for name in PARAMETER_NAMES:
            if name in content:
                allowed = "in the table [parameters]"
                raise InvalidParameter(name, content[name], allowed)
        known = (*cls.model_fields, *term_names())
        for name in content:
            if name not in known:
                raise unknown(name, content[name], known)
        if ("parameters" in content) == ("design" in content):
            problem = "missing, must be a table; or give a table [design]"
            if "design" in content:
                problem = "omit it, or the table [design]"
            raise InvalidParameter("parameters", None, "", problem=problem)
        if "design" in content and content.setdefault("units", "SI") != "SI":
            raise InvalidParameter("units", content["units"], '"SI" with a table [design]')
        return content


def preset_names() -> tuple[str, ...]:
    """Return the sorted names of the devices in the package."""
    names = (item.name for item in _DEVICES.iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml")))


def load_actuator(name_or_path: str | PathLike[str]) -> Actuator:
    """Load an actuator by preset name, or from a TOML file.

    Parameters
    ----------
    name_or_path : str or os.PathLike
        One of `preset_names`, or the path of a TOML file with a table ``[parameters]`` that holds
        the eleven parameters of `Actuator`, or a table ``[design]`` with the quantities of
        `Actuator.from_design`, and, optionally, ``name``, ``description`` and ``units``
        ("SI", or "dimensionless" by default) above it, and below it a table for each term
        (``[squeeze_film]``), and ``[geometry]`` for a `Geometry`. A preset has priority over a file
        of the same name; write ``./name`` for the file.

    Returns
    -------
    Actuator

    Raises
    ------
    InvalidFile
        If there is no such preset or file, or the file cannot be read as TOML.
    InvalidParameter
        If the file holds a wrong, missing or unknown entry; `source` names the file.

    Warns
    -----
    UnitsWarning
        If the file gives no units and its masses look like kilograms; or if a number of a device in
        SI is implausible, as if given in another unit. The second warning is issued once, and may
        also come when the device is combined with a drive.

    See Also
    --------
    Actuator, load

    Examples
    --------
    >>> import mems_impact as mi
    >>> mi.load_actuator("zhao2004").mu_d
    0.27
    >>> mi.load_actuator("mita2003").units
    'SI'
    """
    allowed = "the name of a preset or the path of a TOML file"
    source = file_path(name_or_path, allowed, "name_or_path")
    if isinstance(name_or_path, str) and source in preset_names():
        raw = (_DEVICES / f"{source}.toml").read_bytes()
    else:
        raw = _read(source)
    content = parse_toml(
        raw, source, 'a table [parameters] or [design] of lines like m1 = 5.0 or gap = "4 um"'
    )
    return actuator_in_file(content, source)


def actuator_in_file(content: Mapping[str, Any], source: str) -> Actuator:
    """Return the device of a TOML file."""
    names = term_names()
    tables = {name: content[name] for name in content if name in names}
    try:
        file = _DeviceFile(**{name: content[name] for name in content if name not in names})
        terms = tuple(term_of(name, table, Path(source).parent) for name, table in tables.items())
        geometry = None if file.geometry is None else Geometry(**file.geometry)
        if "design" in content:
            actuator = Actuator.from_design(**file.design, terms=terms, geometry=geometry)
        else:
            if "units" in file.parameters:
                allowed = "above the table [parameters]"
                raise InvalidParameter("units", file.parameters["units"], allowed)
            given: dict[str, Any] = {"units": file.units, "terms": terms, "geometry": geometry}
            actuator = Actuator(**file.parameters, **given)
    except InvalidParameter as error:
        raise error.located(source) from None
    if (
        "units" not in content
        and "design" not in content
        and max(actuator.m1, actuator.m2) < _LIGHT
    ):
        message = (
            f"{source}: m1 = {actuator.m1:g} and m2 = {actuator.m2:g} look like kilograms, but "
            'without units they are dimensionless; write units = "SI" above [parameters], or '
            'units = "dimensionless" if they are'
        )
        warn(message, UnitsWarning, source)
    check_plausible_device(actuator)
    return actuator


def names_in_file(name_or_path: str) -> frozenset[str]:
    """Return the names at the top of a TOML file; none for a preset or another file."""
    if name_or_path in preset_names() or not Path(name_or_path).is_file():
        return frozenset()
    try:
        raw = read_bytes(name_or_path, "", kind="TOML file")
        return frozenset(parse_toml(raw, name_or_path, ""))
    except InvalidFile:
        return frozenset()  # the function that loads the file reports the error


def _read(source: str) -> bytes:
    presets = ", ".join(preset_names())
    remedy = f"give the name of a preset ({presets}) or the path of a TOML file"
    looks_like_path = Path(source).name != source or source.endswith(".toml")
    missing = "no such file" if looks_like_path else "no such preset or file"
    return read_bytes(
        source, remedy, largest=MAX_DEVICE_FILE_BYTES, kind="device file", missing=missing
    )


def device_text(name_or_path: str) -> tuple[str, str]:
    """Return name and description of a device; empty texts if its file has none."""
    source = fspath(name_or_path)
    preset = source in preset_names()
    raw = (_DEVICES / f"{source}.toml").read_bytes() if preset else _read(source)
    content = parse_toml(raw, source, "a device file")
    name = source if preset else content.get("name", "") or stem(source)
    return name, content.get("description", "")
