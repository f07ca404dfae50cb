"""
Studies
=======

A *study* computes attractors over parameters, initial states or tolerances: a table with one row for each
of many independent points. All studies run, store and resume in the same way, so that a map of a million
points on a cluster is the same call as the small one here.
"""

import tempfile
from pathlib import Path

import numpy as np

import mems_impact as mi

actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
store = Path(tempfile.mkdtemp()) / "map"
found = mi.operating_map(
    actuator, drive,
    x=("omega", np.linspace(0.47, 0.5, 6)), y=("amplitude", np.linspace(0.20, 0.28, 12)),
    initial=mi.kicked_state(actuator), recurrence=mi.RecurrenceOptions(exponents="none"),
    store=store,
)  # fmt: skip
print(found.motions[["motion", "points", "share"]].to_string(index=False))
mi.plot_map(found).figure.savefig("studies.png")

# %%
# The store is a directory of Parquet files, which other programs can read. The same call resumes an
# interrupted study, and reads a finished study:

stored = mi.load(store)
print(stored.done, "of", stored.total)
assert stored.done == stored.total == 72

# %%
# A failed point has its reason in ``status``, and the study continues. Kinds of studies:
#
# - operating maps over two parameters, stores and clusters: :doc:`/studies`
# - basins of attraction: :doc:`/basins`
# - manufacturing tolerances: :doc:`/tolerances`
# - sensitivities, optima and Pareto fronts of an orbit: :doc:`/sensitivity`
