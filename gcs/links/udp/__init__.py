"""MAVLink over UDP in batches: sockets, telemetry, commands, setpoints; the base of two transports."""
