"""The impact microactuator: its parameters, its drive and its equations of motion."""

from mems_impact.systems.serialization import STORABLE_MODULES

STORABLE_MODULES.append("mems_impact.actuator.serialization")  # of storable classes
