"""Continuation of periodic orbits, and of their bifurcations in two parameters."""
