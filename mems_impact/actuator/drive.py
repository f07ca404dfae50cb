"""Voltage waveforms in one place: those that `drives.WAVEFORMS` lists, `Drive` and `load_drive`."""

from typing import TYPE_CHECKING

from mems_impact.actuator.drives import WAVEFORMS
from mems_impact.actuator.drives.base import Drive as Drive
from mems_impact.actuator.drives.files import drive_of_kind
from mems_impact.actuator.drives.files import load_drive as load_drive

if TYPE_CHECKING:  # for editors and mypy, which run nothing; a waveform works without
    from mems_impact.actuator.drives.burst import Burst as Burst
    from mems_impact.actuator.drives.custom import Custom as Custom
    from mems_impact.actuator.drives.pulse import Pulse as Pulse
    from mems_impact.actuator.drives.sampled import Sampled as Sampled
    from mems_impact.actuator.drives.sine import Sine as Sine
    from mems_impact.actuator.drives.square import Square as Square
    from mems_impact.actuator.drives.trapezoid import Trapezoid as Trapezoid
    from mems_impact.actuator.drives.two_sided import TwoSided as TwoSided
else:

    def __getattr__(name: str) -> type[Drive]:
        for kind, waveform in WAVEFORMS.items():
            if waveform == name:
                return drive_of_kind(kind)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
