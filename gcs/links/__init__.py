"""Transports: MAVLink bytes on one side, batches of the whole fleet on the other."""

from gcs.links.link import Link, Order, Verb

__all__ = ["Link", "Order", "Verb"]
