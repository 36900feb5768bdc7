"""Flights in virtual time over fake vehicles, for the tests of this project and of programs that use it."""
