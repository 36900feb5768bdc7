"""Transports between MAVLink endpoints and arrays of the fleet; imports only mavlink and model."""

from gcs.links.link import Link, Order, ParameterValue, Verb

__all__ = ["Link", "Order", "ParameterValue", "Verb"]
