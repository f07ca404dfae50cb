"""Voltage waveforms, one per file, with the interface of `drives.base.Drive`."""

from importlib import import_module
from typing import Any

WAVEFORMS = {
    "sine": "Sine",
    "square": "Square",
    "pulse": "Pulse",
    "trapezoid": "Trapezoid",
    "step": "Step",
    "pulse-and-hold": "PulseAndHold",
    "sampled": "Sampled",
    "burst": "Burst",
    "two-sided": "TwoSided",
    "custom": "Custom",
}
"""All waveforms: the kind, as used in files and on the command line, and the class.

The kind with underscores is also the name of the file. Importing this module imports none of them.
"""

_HOMES = {name: kind.replace("-", "_") for kind, name in WAVEFORMS.items()}
_HOMES |= {"Drive": "base", "load_drive": "files"}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
