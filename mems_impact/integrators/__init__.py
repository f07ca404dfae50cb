"""Integrators of smooth arcs, behind one interface."""
