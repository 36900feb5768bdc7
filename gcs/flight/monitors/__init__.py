"""What each tick looks at: telemetry, failsafes, alarms, the show's progress; and the view of it."""
