"""What an aimed attack reports."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Result:
    """One aimed attack: what was tried, the numbers that it gave and what it found."""

    name: str
    tried: int
    figures: str
    findings: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether nothing was found."""
        return not self.findings
