"""Voltage waveforms, one a file, behind the contract of `drives.base.Drive`."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

WAVEFORMS = {
    "sine": "Sine",
    "square": "Square",
    "pulse": "Pulse",
    "trapezoid": "Trapezoid",
    "sampled": "Sampled",
    "burst": "Burst",
    "two-sided": "TwoSided",
    "custom": "Custom",
}
"""All waveforms: the kind, as files and the command line know it, and the class.

The kind is the name of the file too, with underscores. Importing this imports none of them.
"""

if TYPE_CHECKING:  # for editors and mypy, which run nothing; a waveform works without
    from mems_impact.actuator.drives.base import Drive as Drive
    from mems_impact.actuator.drives.burst import Burst as Burst
    from mems_impact.actuator.drives.custom import Custom as Custom
    from mems_impact.actuator.drives.files import load_drive as load_drive
    from mems_impact.actuator.drives.pulse import Pulse as Pulse
    from mems_impact.actuator.drives.sampled import Sampled as Sampled
    from mems_impact.actuator.drives.sine import Sine as Sine
    from mems_impact.actuator.drives.square import Square as Square
    from mems_impact.actuator.drives.trapezoid import Trapezoid as Trapezoid
    from mems_impact.actuator.drives.two_sided import TwoSided as TwoSided
else:
    _HOMES = {name: kind.replace("-", "_") for kind, name in WAVEFORMS.items()}
    _HOMES |= {"Drive": "base", "load_drive": "files"}

    def __getattr__(name: str) -> Any:
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
