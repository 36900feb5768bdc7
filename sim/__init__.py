"""The fake fleet: PX4 or ArduPilot over UDP; imports nothing of gcs, only MAVLink bytes connect them."""
