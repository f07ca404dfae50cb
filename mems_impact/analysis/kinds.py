"""What becomes of a motion, in the words of tables."""

from __future__ import annotations

__all__ = [
    "CHAOTIC", "FAILED", "OFF", "PERIODIC", "QUASI_PERIODIC", "RESTING", "UNSETTLED",
    "counted_periods",
]  # fmt: skip

# One that has not repeated itself in its time is unsettled until its Lyapunov exponent says more.
OFF, RESTING, PERIODIC, UNSETTLED, FAILED = "off", "resting", "periodic", "unsettled", "failed"
CHAOTIC, QUASI_PERIODIC = "chaotic", "quasi-periodic"


def counted_periods(count: int) -> str:
    """Return the name of a periodic motion of so many periods: ``"period 2"``."""
    return f"period {count}"
