"""Figures of what any system did, from what `mems_impact.analysis` returns.

`trajectories` draws runs and orbits, `animation` moves them, `bifurcation` draws sweeps, branches
and curves, `maps` maps and basins, `uncertainty` tolerances, sensitivities and Pareto fronts;
`style` and `labels` are what all share. A kind of system that has a figure of its own names it:
``Run.figure``, ``Orbit.figure``.
"""
