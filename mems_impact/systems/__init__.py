"""Hybrid systems: their interface, systems defined by functions, and components."""
