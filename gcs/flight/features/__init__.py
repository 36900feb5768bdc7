"""What a flight can do beside a formation: targets, traffic, Remote ID, fences, RTK, lights, timecode."""
