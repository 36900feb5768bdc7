"""Written shows: format, timeline, validation, library; imports config, service and what lies below."""

from gcs.config.yaml_files import SHOWS
from gcs.shows.clock import ShowClock as ShowClock
from gcs.shows.flaws import Flaw as Flaw
from gcs.shows.format import Show as Show
from gcs.shows.loading import LoadedShow as LoadedShow
from gcs.shows.loading import load as load
from gcs.shows.loading import parse as parse
from gcs.shows.timeline import Played as Played
from gcs.shows.timeline import Timeline as Timeline

find, shipped = SHOWS.find, SHOWS.shipped
