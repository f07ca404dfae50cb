"""Systems that users define, and what all systems have in common."""
