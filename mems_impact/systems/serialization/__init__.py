"""Result files: an open format that needs only NumPy and runs no code."""

STORABLE_MODULES = ["mems_impact.analysis.serialization", "mems_impact.studies.serialization"]
"""Modules that register storable classes (`codec.register`); a model adds its own.

They are imported when a file is written or read. A file refers to classes by their registered short
names, never by modules.
"""
