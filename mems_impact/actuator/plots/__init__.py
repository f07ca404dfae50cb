"""Figures of a device."""
