"""Export of systems to other tools, as C source and functional mock-up units."""
