"""What each tick looks at: telemetry, failsafes, alarms; and the view that displays get of it."""
