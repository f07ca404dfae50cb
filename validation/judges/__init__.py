"""Judges: the actuator integrated anew from the paper's equations, by nothing of `mems_impact`.

`dop853_free` and `heyoka_free` know a free block under a sine and each impact; the latter is the
package's rival in the benchmarks too. `heyoka_full` knows rest contact and any voltage in pieces.
"""
