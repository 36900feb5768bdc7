"""Transports between MAVLink endpoints and arrays of the fleet; imports only mavlink and model."""

from gcs.links.link import Command, Link, ParameterValue, Verb

__all__ = ["Command", "Link", "ParameterValue", "Verb"]
