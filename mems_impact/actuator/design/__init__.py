"""Design of actuators: steps, speeds, voltages, fits to measurements, operating charts."""
