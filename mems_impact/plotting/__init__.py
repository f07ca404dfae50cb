"""All of matplotlib: one kind of figure a file."""
