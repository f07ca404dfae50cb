"""The event loop: one source, interpreted and compiled."""
