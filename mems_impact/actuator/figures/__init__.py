"""Figures that an actuator has beside those of any system (see `mems_impact.plotting`)."""
