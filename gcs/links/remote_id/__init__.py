"""Remote ID: what is sent to transponders behind the autopilots, and what they report."""
