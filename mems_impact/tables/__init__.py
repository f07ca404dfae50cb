"""Tables of what any system did: from columns of numbers to pandas DataFrames."""
