"""A service over a recorded flight: playhead, events, marks, alarms; it refuses commands."""
