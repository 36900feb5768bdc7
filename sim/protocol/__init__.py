"""MAVLink of the fake vehicles: frames, reports, commands, parameters, setpoints; `autopilot` is PX4's."""
