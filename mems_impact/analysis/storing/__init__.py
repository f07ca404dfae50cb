"""Results in files: an open format that needs nothing but NumPy, and runs no code."""

ROOMS = ["mems_impact.analysis.stored", "mems_impact.studies.stored"]
"""Modules that register what may be in a file (`coding.register`); a model adds its own.

They are imported when a file is written or read. A file names classes by the short names under
which they are registered here, never by modules.
"""
