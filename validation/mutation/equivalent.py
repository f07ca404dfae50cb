"""Mutants that change nothing that could be seen, each with the reason; known by their text."""

from __future__ import annotations

# (path, what stood there, what stands there now): why no test can tell.
EQUIVALENT: dict[tuple[str, str, str], str] = {}
