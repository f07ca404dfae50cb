"""Figures of any system, from the results of `mems_impact.analysis` and `mems_impact.studies`.

`trajectories` draws runs and orbits, `animation` animates them, `bifurcation` draws sweeps,
branches and curves, `maps` maps and basins, `uncertainty` tolerances, sensitivities and Pareto
fronts. All share `style` and `labels`. A kind of system with its own figures names them in
``Run.figure`` and ``Orbit.figure``.
"""
