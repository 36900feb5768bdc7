"""Carries the newest messages between a site's stations: Zenoh, or shared memory."""

from gcs.bus.interface import PAYLOAD_MAX, Bus, Received, keep_bus_open

__all__ = ["PAYLOAD_MAX", "Bus", "Received", "keep_bus_open"]
