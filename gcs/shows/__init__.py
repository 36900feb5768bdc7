"""Written shows: format, timeline, validation, library; imports config, service and what lies below."""

from gcs.config.yaml_files import SHOWS
from gcs.shows.format import Show
from gcs.shows.loading import LoadedShow, load, parse
from gcs.shows.timeline import Played, ShowClock, Timeline
from gcs.shows.validation import Flaw

find, shipped = SHOWS.find, SHOWS.shipped

__all__ = [
    "Flaw",
    "LoadedShow",
    "Played",
    "Show",
    "ShowClock",
    "Timeline",
    "find",
    "load",
    "parse",
    "shipped",
]
