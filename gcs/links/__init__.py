"""Transports between MAVLink endpoints and arrays of the fleet; imports only mavlink and model."""

from gcs.links.link import Command, ParameterValue, Verb

__all__ = ["Command", "ParameterValue", "Verb"]
