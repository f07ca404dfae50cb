"""Attractors of many initial conditions."""
