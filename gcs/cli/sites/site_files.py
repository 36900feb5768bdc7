"""`gcs site check` and `gcs site convert`: the file of a site, what is in it, and in another format."""

import argparse
from pathlib import Path
from typing import Any, Final

from gcs.areas.files.reading import Heights
from gcs.areas.files.site_files import FORMATS, read_site, written
from gcs.areas.site import FlightSite, frame_at, polygon_m
from gcs.cli.output import answer
from gcs.config import schema
from gcs.config.schema import Config
from gcs.model.errors import ConfigError, SiteError

NO_SITE: Final = "it names no site: give it site: FILE.geojson"


def heights_of(arguments: argparse.Namespace) -> Heights | None:
    """Heights for areas that have none in the file; None: none are given."""
    if arguments.heights is None:
        return None
    least_m, greatest_m = arguments.heights
    return Heights(least_m, greatest_m)


def site_named(name: str, heights: Heights | None) -> tuple[FlightSite, Config | None, Path]:
    """The site of a file, or of a configuration that names one. Raises: ConfigError."""
    if Path(name).suffix.lower() in FORMATS:
        return read_site(Path(name), heights), None, Path(name)
    path = schema.find(name)
    config = schema.load(path)
    if config.flight_site is None or config.site is None:
        raise ConfigError(f"{path}: {NO_SITE}")
    return config.flight_site, config, config.site


def document_of(site: FlightSite) -> dict[str, Any]:
    """A site as `--json` has it."""
    latitude_deg, longitude_deg = site.flight_geography.corners[0]
    frame = frame_at((latitude_deg, longitude_deg))
    return {
        "name": site.name,
        "hash": site.digest,
        "latitude_deg": latitude_deg,
        "longitude_deg": longitude_deg,
        "uploaded_corners": sum(len(area.corners) for area in site.uploaded),
        "areas": [
            {
                "kind": str(area.kind),
                "name": area.name,
                "corners": len(area.corners),
                "size_m2": round(polygon_m(frame, area).area, 1),
                "height_min_m": area.height_min_m,
                "height_max_m": area.height_max_m,
            }
            for area in site.areas
        ],
    }


def check_site(arguments: argparse.Namespace) -> int:
    """Print what a site has. Returns: 0. Raises: SiteError, ConfigError with all that is wrong."""
    site, config, path = site_named(arguments.site, heights_of(arguments))
    document = {"file": str(path), **document_of(site)}
    lines = [f"{site.name}: {len(site.areas)} areas, without mistakes; hash {site.digest}"]
    for each in document["areas"]:
        top = "without a limit" if each["height_max_m"] is None else f"to {each['height_max_m']:g} m"
        lines.append(
            f"  {each['kind']:<17} {each['name']}: {each['corners']} corners, {each['size_m2']:.0f} m^2,"
            f" from {each['height_min_m']:g} m {top}"
        )
    at = f"latitude {document['latitude_deg']:.5f}, longitude {document['longitude_deg']:.5f}"
    lines.append(f"  the first corner of the flight geography is at {at}: compare it with a map")
    lines.append(f"  {document['uploaded_corners']} corners go to the autopilots, of 64 that PX4 keeps")
    if config is None:
        lines.append("  whether it is wide enough: gcs site volumes CONFIG, of a configuration that names it")
    else:
        lines.append("  it lies about the configuration's show frame, and the first formation fits")
    answer(arguments, document, "\n".join(lines))
    return 0


def convert_site(arguments: argparse.Namespace) -> int:
    """Write a site in another format. Returns: 0. Raises: SiteError, ConfigError."""
    site, _, path = site_named(arguments.site, heights_of(arguments))
    target = Path(arguments.output)
    save(target, written(site, target))
    text = f"{path} is {target} now; hash {site.digest}"
    answer(arguments, {"file": str(target), **document_of(site)}, text)
    return 0


def save(target: Path, data: bytes) -> None:
    """Write a file. Raises: SiteError when it cannot be written."""
    try:
        target.write_bytes(data)
    except OSError as error:
        raise SiteError(str(target), f"cannot be written: {error.strerror or error}") from None
