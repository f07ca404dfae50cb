"""What users ask of the actuator: runs, sweeps, orbits, branches, the chart, design, fits."""
