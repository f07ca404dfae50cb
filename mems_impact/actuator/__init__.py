"""The impact microactuator: its parameters, its drive and its equations of motion."""
