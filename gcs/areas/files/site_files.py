"""Reads and writes the file of a site, in the format that its name ends with."""

from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from gcs.areas.files import geojson, kml, qgc_plan
from gcs.areas.files.reading import Heights
from gcs.areas.site import FlightSite
from gcs.model.errors import SiteError

SIZE_MAX_BYTES: Final = 1_000_000


class SiteFormat(NamedTuple):
    """A format of files."""

    read: Callable[[bytes, str, Heights], FlightSite]
    write: Callable[[FlightSite], bytes]


FORMATS: Final = {
    ".geojson": SiteFormat(geojson.read, geojson.write),
    ".json": SiteFormat(geojson.read, geojson.write),
    ".kml": SiteFormat(kml.read, kml.write),
    ".plan": SiteFormat(qgc_plan.read, qgc_plan.write),
}


def format_of(path: Path) -> SiteFormat:
    """The format of a file, by its name. Raises: SiteError."""
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise SiteError(str(path), f"a name that ends in {', '.join(FORMATS)} is needed")
    return kind


def read_site(path: Path, heights: Heights | None = None) -> FlightSite:
    """Read a site.

    Args:
        path: of a file in a format of `FORMATS`.
        heights: of areas for which the file has none; None: from the origin's height on, without a limit.

    Raises: SiteError that names the file, the area and the corner, and what would be right.
    """
    kind = format_of(path)
    try:
        with path.open("rb") as file:
            data = file.read(SIZE_MAX_BYTES + 1)
    except OSError as error:
        raise SiteError(str(path), f"cannot be read: {error.strerror or error}") from None
    if len(data) > SIZE_MAX_BYTES:
        raise SiteError(str(path), f"larger than {SIZE_MAX_BYTES} bytes: a site has some thousands")
    return kind.read(data, str(path), heights or Heights())


def written(site: FlightSite, path: Path) -> bytes:
    """The bytes of a site in the format of a file's name. Raises: SiteError."""
    return format_of(path).write(site)
