"""Written shows: format, timeline, validation, library; imports config, service and what lies below."""

from pathlib import Path

from gcs.config.yaml_files import SHOWS
from gcs.model.errors import ConfigError
from gcs.shows.clock import ShowClock as ShowClock
from gcs.shows.flaws import Flaw as Flaw
from gcs.shows.format import Show as Show
from gcs.shows.formats import IMPORTED
from gcs.shows.loading import LoadedShow as LoadedShow
from gcs.shows.loading import load as load
from gcs.shows.loading import parse as parse
from gcs.shows.timeline import Played as Played
from gcs.shows.timeline import Timeline as Timeline

shipped = SHOWS.shipped


def find(name: str) -> Path:
    """Find a show file by path, or a shipped one by name. Raises: ConfigError, for a drawing as well."""
    path = SHOWS.find(name)
    if path.suffix.lower() in IMPORTED:
        made = f"gcs show import {name} -o {path.stem}.yaml"
        raise ConfigError(f"{name}: a drawing, not a show file: make a show of it first: {made}")
    return path
