"""What a flight knows: its vehicles, the plan, the show that runs, and when its ticks come."""
