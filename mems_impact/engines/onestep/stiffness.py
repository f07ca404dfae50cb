"""What is said once a run whose steps stability has limited is over."""

from __future__ import annotations

import warnings

from mems_impact.errors import StiffnessWarning


def warn() -> None:
    """Warn, for the close of an engine at the end of a run, in the name of who asked for it."""
    message = (
        "the system is stiff: stability, not accuracy, limits the steps of method 'dop853'; "
        "method='bdf' may be faster"
    )
    warnings.warn(message, StiffnessWarning, stacklevel=6)
