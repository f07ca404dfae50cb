"""
Studies
=======

What many motions come to, over parameters, states or tolerances: a *study* is a list of independent
points (or chains of them) and one row a point. All kinds are run, kept and gone on with in the same
way, so that a map of a million points on a cluster is the same call as a small one here.
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
    initial=mi.kicked(actuator), settle=mi.Settling(exponents="none"),
    store=store,
)  # fmt: skip
print(mi.map_summary(found.table)[["motion", "points", "share"]].to_string(index=False))
mi.plot_map(found).figure.savefig("studies.png")

# %%
# The store is a directory that any other program can read. The same call goes on where it was
# interrupted, and only reads what is finished:

stored = mi.read_study(store)
print(stored.done, "of", stored.total)
assert stored.done == stored.total == 72

# %%
# A point that fails is a row with its reason in ``status``; it ends no study. Kinds of studies:
#
# - what motions come to over two parameters: :doc:`/maps`
# - from many states: :doc:`/basins`
# - under tolerances of manufacture: :doc:`/scatter`
# - derivatives, optima and fronts of an orbit: :doc:`/sensitivity`
#
# How they are run and kept: :doc:`/studies`; on many machines: :doc:`/cluster`.
