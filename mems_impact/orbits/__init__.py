"""Periodic orbits of hybrid automata: shooting, Floquet multipliers, admissibility."""
