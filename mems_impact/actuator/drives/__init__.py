"""Voltage waveforms, one a file, behind the contract of `drives.base.Drive`."""
