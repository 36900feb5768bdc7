"""The fake fleet: PX4-like autopilots over UDP; imports nothing of gcs, only MAVLink bytes connect them."""
