"""The engine of studies, independent of their kinds: scheduling, executors, stores."""

EXECUTORS = ("threads", "processes")
"""Executors by the name that files and the command line give them."""
