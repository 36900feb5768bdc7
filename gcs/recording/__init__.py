"""Records of flights: audit in SQLite, flight data in MCAP; imports service, links and what lies below."""

from gcs.recording.last_known import LastKnown, last_known

__all__ = ["LastKnown", "last_known"]
