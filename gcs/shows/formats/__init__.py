"""Formats of drawn shows: readers that trust no file, and writers. What was drawn is in `gcs.shows.drawn`."""

from gcs.shows.formats.files import EXPORTED as EXPORTED
from gcs.shows.formats.files import IMPORTED as IMPORTED
from gcs.shows.formats.files import parse_drawing as parse_drawing
from gcs.shows.formats.files import read_drawing as read_drawing
from gcs.shows.formats.files import write_drawing as write_drawing
