"""ArduCopter 4.1-dev as it was recorded. Numbers of habits are those of FACTS-ARDUPILOT.md."""
