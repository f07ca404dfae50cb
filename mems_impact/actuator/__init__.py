"""The impact microactuator: its parameters, its drive and its equations of motion."""

from mems_impact.analysis.storing import ROOMS

ROOMS.append("mems_impact.actuator.stored")  # of what may stand in a saved file
