"""Targets that move, and send where they are in the formats of real sources, with the errors of receivers."""
