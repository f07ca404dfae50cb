"""Parts that stand ready: friction, stopper, relay, switching surface; one file each.

`part` says what a part is, `contact` what those between bodies share, `text` puts the parts of a
system together into one flow and one choice of modes, `assembly` makes of these what a `System`
is written of.
"""
