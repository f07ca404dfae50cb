"""A command that cannot be imported."""

raise RuntimeError("no licence\nfor today")
