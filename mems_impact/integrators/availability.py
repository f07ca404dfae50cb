"""Engines that this machine has, and what replaces others."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import Any

from mems_impact._util.formatting import class_name
from mems_impact._util.warning_scopes import warn
from mems_impact.errors import EngineFallbackWarning, EngineUnavailable
from mems_impact.integrators.options import FOLDERS, Options


def engine_class(options: Options) -> Any:
    """Return the class of an engine, such as `CompiledCvode` in ``cvode/compiled.py``."""
    form = "compiled" if is_compiled(options) else "interpreted"
    return getattr(_module(form, options), class_name(f"{form}_{FOLDERS[str(options.method)]}"))


def is_compiled(options: Options) -> bool:
    """Return whether runs with available `options` are compiled, and release the GIL."""
    return options.engine != "interpreted"


def available_options(options: Options) -> Options:
    """Return the options with a method and an engine that this machine has.

    Without SUNDIALS' C functions ``"dop853"`` replaces Adams, and BDF within ``"auto"``; BDF alone
    is interpreted. An `EngineFallbackWarning` names the replacement of a requested method; raises
    `EngineUnavailable` where engine="compiled" and the method cannot be compiled.
    """
    if options.engine == "interpreted":
        return options
    try:
        _module("compiled", options).prepare()
    except EngineUnavailable as error:
        other = replace(options, method="dop853")
        if options.method == "auto" and _can_compile(other):
            return other
        if options.engine == "compiled":
            raise
        if options.method == "adams" and _can_compile(other):
            warn(f"{error}; method 'dop853' replaces 'adams'", EngineFallbackWarning)
            return other
        message = f"{error}; falling back to the interpreted engine, which is far slower"
        warn(message, EngineFallbackWarning)
        return replace(options, engine="interpreted")
    return options


def _can_compile(options: Options) -> bool:
    try:
        _module("compiled", options).prepare()
    except EngineUnavailable:
        return False
    return True


def _module(form: str, options: Options) -> Any:
    """Import the "compiled" or "interpreted" module of the method."""
    return import_module(f"mems_impact.integrators.{FOLDERS[str(options.method)]}.{form}")
