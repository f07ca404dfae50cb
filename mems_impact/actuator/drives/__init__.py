"""Voltage waveforms, one a file, behind the contract of `drives.base.Drive`."""

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
