"""One column per vehicle: dynamics, sensors, battery, modes and transitions of a PX4-like autopilot."""
