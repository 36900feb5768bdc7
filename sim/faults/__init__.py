"""Faults of vehicles and links, the commands that inject them, and their end."""
