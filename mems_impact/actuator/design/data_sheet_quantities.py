"""Quantities of a data sheet: units, meanings and parameters."""

from __future__ import annotations

from typing import NamedTuple


class Entry(NamedTuple):
    """A quantity of a data sheet."""

    unit: str
    meaning: str
    parameter: str = ""
    """The parameter of `Actuator` that it is, if any."""


QUANTITIES = {
    "frame_mass": Entry("kg", "mass of the frame", "m1"),
    "proof_mass": Entry("kg", "mass of the block", "m2"),
    "total_mass": Entry("kg", "mass of frame and block"),
    "mass_ratio": Entry("", "frame mass over proof mass"),
    "stiffness": Entry("N/m", "stiffness of the spring", "k"),
    "frequency": Entry("Hz", "resonance of the block in a held frame"),
    "damping": Entry("N s/m", "damping coefficient of the block", "c"),
    "quality": Entry("", "quality factor of the block"),
    "damping_ratio": Entry("", "damping ratio of the block"),
    "gap": Entry("m", "gap between the electrodes without voltage", "d"),
    "travel": Entry("m", "distance from the block at rest to each stopper", "delta"),
    "spring_force": Entry("N", "spring force at the stopper"),
    "restitution": Entry("", "coefficient of restitution", "e"),
    "electrode_area": Entry("m^2", "overlap area of the electrodes, in vacuum or air"),
    "capacitance": Entry("F", "capacitance of the electrodes without voltage"),
    "electrode_constant": Entry("F m", "half the permittivity times the electrode area", "alpha"),
    "pull_in": Entry("V", "pull-in voltage"),
    "release": Entry("V", "voltage below which the block leaves the stopper"),
    "static_friction": Entry("", "coefficient of static friction", "mu_s"),
    "dynamic_friction": Entry("", "coefficient of dynamic friction", "mu_d"),
    "normal_force": Entry("N", "normal force of the frame on a level ground"),
    "clamp_force": Entry("N", "force of clamps, which adds to the weight"),
    "static_friction_force": Entry("N", "force at which the frame begins to slip"),
    "dynamic_friction_force": Entry("N", "friction force on the slipping frame"),
    "gravity": Entry("m/s^2", "gravity", "g"),
}
"""Quantities of a data sheet, in the order of its rows."""

OF_PARAMETER = {entry.parameter: name for name, entry in QUANTITIES.items() if entry.parameter}
"""The quantity of each parameter."""
