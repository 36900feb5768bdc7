"""Flights in virtual time over fake vehicles, for tests: of this project, and of those who build on it."""
