"""Hybrid automata and their event loop. Knows no device and no unit."""
