"""Devices from a drawing and a process: springs, masses, electrodes and films by formulas."""
