"""Figures of what any system did, from what `mems_impact.analysis` returns.

One kind of figure a file: `run`, `orbit`, `sweep`, `branch`, `curve`, `sensitivity`, `pareto`;
`motion` is what the first two share. A kind of system that has a figure of its own names it:
``Run.figure``, ``Orbit.figure``.
"""
