"""Checks before a start, with the parameters that the vehicles report."""
