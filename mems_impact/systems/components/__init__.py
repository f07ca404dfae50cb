"""Ready-made components: friction, stopper, relay and switching surface.

`base` defines parts and contacts between bodies, `statics` decides whether contacts hold, and
`assembly` combines the parts of a system into one flow and one selection of modes.
"""
