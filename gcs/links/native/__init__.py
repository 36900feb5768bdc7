"""The native transport: our own MAVLink, for all vehicles of a link at once."""
