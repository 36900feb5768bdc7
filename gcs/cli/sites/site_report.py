"""`gcs site report`: what an authority asks for, as one page of HTML that prints, and as KML beside it."""

import argparse
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from gcs.areas.files.kml import with_data
from gcs.areas.site import FlightSite
from gcs.areas.volumes import compared
from gcs.cli.output import answer
from gcs.cli.sites.fleet_kinds import read_parameters, volumes_of
from gcs.cli.sites.site_files import NO_SITE, save
from gcs.cli.sites.site_page import SiteReported, page
from gcs.cli.sites.site_volumes import config_on_site
from gcs.config.schema import Config
from gcs.flight.state.start_hashes import parameters_hash
from gcs.model.errors import ConfigError
from gcs.shows import LoadedShow, find, load
from gcs.shows.area_checks import area_flaws
from gcs.shows.loading import service_flaws
from gcs.shows.service_rules import ServiceRules


def site_report(arguments: argparse.Namespace) -> int:
    """Write both. Returns: 0; 1 where a volume or the show does not fit. Raises: ConfigError."""
    config = config_on_site(arguments.config)
    site, target = config.flight_site, Path(arguments.output)
    if site is None:
        raise ConfigError(NO_SITE)
    if target.suffix.lower() not in {".html", ".htm"}:
        raise ConfigError(f"{target}: a name that ends in .html is needed")
    show = None if arguments.show is None else load(find(arguments.show))
    reported = _reported(config, site, show, arguments)
    save(target, page(reported).encode())
    save(target.with_suffix(".kml"), with_data(site, _about(reported)))
    document = {"html": str(target), "kml": str(target.with_suffix(".kml")), "good": reported.is_good}
    words = "good" if reported.is_good else "NOT GOOD: it says what is missing"
    answer(arguments, document, f"{target}, {target.with_suffix('.kml').name}: {words}")
    return 0 if reported.is_good else 1


def _reported(
    config: Config, site: FlightSite, show: LoadedShow | None, arguments: argparse.Namespace
) -> SiteReported:
    read = read_parameters(arguments.parameters)
    volumes = volumes_of(config, read)
    return SiteReported(
        config=config,
        site=site,
        source=Path(str(config.site)).name,
        volumes=volumes,
        beside=compared(site, volumes),
        read=read,
        parameters_hash=parameters_hash(config.ids, read),
        show=show,
        problems=() if show is None else _problems(config, show),
        software=f"formation-gcs {version('formation-gcs')}",
        made=f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
    )


def _problems(config: Config, show: LoadedShow) -> tuple[str, ...]:
    """Why a service with this configuration does not fly the show, in words."""
    rules = ServiceRules.of(config.control, config.operation)
    flaws = [
        *service_flaws(show.show, config.frame, config.control, config.operation, len(config.fleet)),
        *area_flaws(show.timeline, rules),
    ]
    return tuple(str(show.problem(flaw)) for flaw in flaws)


def _about(reported: SiteReported) -> dict[str, str]:
    """What the KML says of the whole."""
    about = {
        "site_hash": reported.site.digest,
        "show_hash": "" if reported.show is None else reported.show.show.digest,
        "parameters_hash": reported.parameters_hash,
        "software": reported.software,
        "made": reported.made,
    }
    for volumes in reported.volumes:
        for extent in (volumes.contingency, volumes.contingency_height, volumes.ground_risk):
            about[f"{extent.what}, {volumes.method}, {volumes.autopilot}"] = f"{extent.value_m:.2f} m"
    return {key: value for key, value in about.items() if value}
