"""Parts that stand ready: friction and stopper (`contact`), relay and surface (`switching`).

`base` says what a part is and what contacts between bodies share; `statics` whether contacts hold;
`assembly` puts the parts of a system together into one flow and one choice of modes.
"""
