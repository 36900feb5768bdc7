"""Carries the newest messages between the stations of one site: Zenoh, or memory in virtual time."""

from gcs.bus.interface import PAYLOAD_MAX, Bus, Received, keep_bus_open

__all__ = ["PAYLOAD_MAX", "Bus", "Received", "keep_bus_open"]
