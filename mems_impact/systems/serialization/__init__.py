"""Results in files: an open format that needs nothing but NumPy, and runs no code."""

STORABLE_MODULES = ["mems_impact.analysis.serialization", "mems_impact.studies.serialization"]
"""Modules that register what may be in a file (`codec.register`); a model adds its own.

They are imported when a file is written or read. A file names classes by the short names under
which they are registered here, never by modules.
"""
