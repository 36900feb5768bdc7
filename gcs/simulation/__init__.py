"""Virtual time: scenarios, metrics, show rehearsal; imports 13 packages, from flight to sim."""

from typing import Final

ROWS: Final = (
    *("shape", "saddle", "article", "tracking", "tracking-real", "separation", "uncertainty", "obstacles"),
    *("moving-boxes", "traffic", "concave", "wind", "delays", "authority", "changes", "neighbours"),
    *("laws", "landing", "loss", "return", "stations", "drawn", "mixed"),
)
"""The rows of docs/flight-quality.md: scenarios that answer the same question."""
