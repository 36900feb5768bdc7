"""Trajectories, pair distances and the flight report of a recorded flight."""
