"""Shows: written beforehand, checked on the ground, flown by the same tick as everything else."""

from gcs.config.yaml_files import SHOWS
from gcs.show.clock import ShowClock
from gcs.show.loading import LoadedShow, load, parse
from gcs.show.model import Show
from gcs.show.rules import Flaw
from gcs.show.timeline import Played, Timeline

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
