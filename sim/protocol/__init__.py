"""MAVLink of the fake vehicles: frames, telemetry reports, commands, setpoints."""
