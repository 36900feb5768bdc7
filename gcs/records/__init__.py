"""The record of a flight: orders and events in SQLite, what was flown in MCAP; written, read, judged."""

from gcs.records.known import LastKnown, last_known

__all__ = ["LastKnown", "last_known"]
