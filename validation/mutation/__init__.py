"""Are the tests sharp? Small faults are put into the numerics, one at a time, and must be noticed.

``python -m validation.mutation --seed 1 --mutants 100`` draws the same mutants on every machine for
the same sources. At most one in twenty may survive.
"""
