"""
Studies
=======

A *study* computes what many motions settle to, over parameters, initial states or tolerances: a list
of independent points (or chains of them), with one row a point. All kinds are run, stored and resumed
in the same way, so that a map of a million points on a cluster is the same call as a small one here.
"""

import tempfile
from pathlib import Path

import numpy as np

import mems_impact as mi

actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
store = Path(tempfile.mkdtemp()) / "map"
found = mi.operating_map(
    actuator, drive,
    x=("amplitude", np.linspace(0.20, 0.28, 12)), y=("omega", np.linspace(0.47, 0.5, 6)),
    initial=mi.kicked_state(actuator), recurrence=mi.RecurrenceOptions(exponents="none"),
    store=store,
)  # fmt: skip
print(mi.map_summary(found.table)[["motion", "points", "share"]].to_string(index=False))
mi.plot_map(found).figure.savefig("studies.png")

# %%
# The store is a directory of Parquet files, which other programs can read. The same call resumes a
# study where it was interrupted, and only reads one that is finished:

stored = mi.read_study(store)
print(stored.done, "of", stored.total)
assert stored.done == stored.total == 72

# %%
# A point that fails is a row with its reason in ``status``, and the study goes on. Kinds of studies:
#
# - kinds of motions over two parameters: :doc:`/maps`
# - attractors reached from many initial states: :doc:`/basins`
# - tolerance analysis, of manufacture: :doc:`/tolerances`
# - derivatives, optima and fronts of an orbit: :doc:`/sensitivity`
#
# :doc:`/studies` describes how they are run and stored, :doc:`/cluster` how on many machines.
