"""Transports: MAVLink bytes on one side, batches of the whole fleet on the other."""

from gcs.links.link import Link, Order, ParameterValue, Verb

__all__ = ["Link", "Order", "ParameterValue", "Verb"]
