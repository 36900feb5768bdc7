"""Carries the newest messages between a site's stations: Zenoh, on one machine memory, or a virtual bus."""

from gcs.bus.interface import PAYLOAD_MAX, Bus, Received, keep_bus_open

__all__ = ["PAYLOAD_MAX", "Bus", "Received", "keep_bus_open"]
