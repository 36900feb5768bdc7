"""What is known of each autopilot's failsafes."""
