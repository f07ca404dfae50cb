"""Voltage waveforms: value, rate, forcing period and switching times; one file each in `drives`."""

from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.drives.burst import Burst
from mems_impact.actuator.drives.custom import Custom
from mems_impact.actuator.drives.files import load_drive
from mems_impact.actuator.drives.pulse import Pulse
from mems_impact.actuator.drives.sampled import Sampled
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.drives.square import Square
from mems_impact.actuator.drives.trapezoid import Trapezoid
from mems_impact.actuator.drives.two_sided import TwoSided

__all__ = [
    "Burst",
    "Custom",
    "Drive",
    "Pulse",
    "Sampled",
    "Sine",
    "Square",
    "Trapezoid",
    "TwoSided",
    "load_drive",
]
