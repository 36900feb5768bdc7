"""A fake autopilot: point masses that speak MAVLink 2 like PX4."""
