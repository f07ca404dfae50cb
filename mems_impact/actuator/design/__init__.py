"""What a designer of an actuator asks: steps, speeds and voltages, a fit, the operating chart."""
