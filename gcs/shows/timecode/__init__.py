"""Timecode: MIDI and linear timecode as bytes, and how a show follows it. Only `receiver` does I/O."""

from gcs.shows.timecode.chase import Chase as Chase
from gcs.shows.timecode.chase import ChaseState as ChaseState
from gcs.shows.timecode.smpte import Rate as Rate
from gcs.shows.timecode.smpte import Reading as Reading
