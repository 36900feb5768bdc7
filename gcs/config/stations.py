"""Several stations of one site: their sections, and what must fit together."""

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Annotated, Final

from pydantic import Field

from gcs.bus.settings import Endpoint
from gcs.config.sections import ApiSettings, Urls
from gcs.config.setting_errors import located
from gcs.links.features import StationInputs
from gcs.model.settings import Settings
from gcs.stations.messages import COUNT_MAX

STATIONS_MAX: Final = 100

LOOPBACK: Final = "loopback"
"""Stands for the one machine on which stations reach each other over loopback."""


class StandbySettings(Settings):
    """Another station's link that a station receives as well, and takes over when that one is lost."""

    link: str
    """Name of the other station's link."""
    listen: Urls
    """Endpoints of its own for that link: a mirrored port, or its radio of the same network."""


class StationSettings(StationInputs):
    """One station: the links that it owns, and where other stations and clients reach it."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")]
    """Name of the station: `gcs serve --station NAME`."""
    links: tuple[str, ...] = ()
    """Names of the links that it owns."""
    endpoint: Endpoint
    """Where it listens for the other stations."""
    api: ApiSettings | None = None
    """Its own API; null: as the whole site's."""
    standby: tuple[StandbySettings, ...] = ()
    """Links of other stations that it takes over when those are lost."""

    @property
    def machine(self) -> str:
        """The host on which it runs; stations with the same one share its ports."""
        return LOOPBACK if self.endpoint.is_loopback else self.endpoint.host.lower()


class SiteRows(Settings):
    """Which of the site's vehicles are those of one station."""

    station: str
    """Name of the station."""
    count: Annotated[int, Field(ge=1)]
    """Number of vehicles of the site."""
    rows: tuple[Annotated[int, Field(ge=0)], ...]
    """Rows of the station's vehicles among them."""
    standby: int = 0
    """So many at the end are another station's."""
    mixed: bool = False
    """Whether the site has several autopilots."""


def check_stations(
    stations: Sequence[StationSettings], counts: Mapping[str, int], api: ApiSettings, keys: Path | None
) -> None:
    """Check that the stations fit together.

    Args:
        stations: at least one.
        counts: vehicles of each link of the file, by name.
        api: of stations that have none of their own.
        keys: the folder of certificates; None: there are none.

    Raises: the located error of the first problem.
    """
    if not 2 <= len(stations) <= STATIONS_MAX:
        text = (
            f"2 to {STATIONS_MAX} are possible, not {len(stations)}; leave it out where one station flies all"
        )
        raise located(text, "stations")
    _check_links(stations, counts)
    names: set[str] = set()
    endpoints: dict[tuple[str, int], str] = {}
    ports: dict[tuple[str, int], str] = {}
    for at, station in enumerate(stations):
        if station.name in names:
            raise located("another station has this name", "stations", at, "name")
        names.add(station.name)
        if keys is None and not station.endpoint.is_loopback:
            text = (
                "beyond 127.0.0.1 certificates are needed: bus.keys: FOLDER, then gcs key site FOLDER"
                " --config FILE"
            )
            raise located(text, "stations", at, "endpoint", "host")
        other = endpoints.setdefault((station.machine, station.endpoint.port), station.name)
        if other != station.name:
            raise located(f"{other} has this endpoint", "stations", at, "endpoint", "port")
        own = station.api or api
        for port in {own.port, own.lane_port} - {0}:
            other = ports.setdefault((station.machine, port), station.name)
            if other != station.name:
                text = f"port {port} is {other}'s, on the same machine; an API has two, api.port and the next"
                raise located(text, "stations", at, *(("api", "port") if station.api else ("name",)))
    for (machine, port), name in ports.items():
        here = endpoints.get((machine, port))
        if here is not None:
            at = next(at for at, station in enumerate(stations) if station.name == here)
            raise located(f"port {port} is that of {name}'s API", "stations", at, "endpoint", "port")


def check_inputs(stations: Sequence[StationSettings], site: StationInputs) -> None:
    """Check that no two stations of one machine receive at one place. Raises: the located error of the first.

    `site` has the inputs of stations that have none of their own.
    """
    places: dict[tuple[str, str], str] = {}
    for name, (at, station) in product(StationInputs.model_fields, enumerate(stations)):
        own = getattr(station, name) or getattr(site, name)
        other = (
            station.name if own is None else places.setdefault((station.machine, own.source), station.name)
        )
        if other != station.name:
            text = f"{other} receives {name} at {own.source} as well, on the same machine"
            raise located(text, "stations", at, *((name, "source") if getattr(station, name) else ("name",)))


def _check_links(stations: Sequence[StationSettings], counts: Mapping[str, int]) -> None:
    owners: dict[str, str] = {}
    for at, station in enumerate(stations):
        if not station.links and not station.standby:
            raise located("at least one link, of its own or on standby, is needed", "stations", at, "links")
        for number, link in enumerate(station.links):
            if link not in counts:
                raise located(f"one of the links {', '.join(counts)}", "stations", at, "links", number)
            if link in owners:
                text = f"{owners[link]} has this link: each belongs to one station"
                raise located(text, "stations", at, "links", number)
            owners[link] = station.name
        count = sum(counts[link] for link in station.links)
        count += _check_standby(at, station, counts)
        if count > COUNT_MAX:
            text = f"{count} vehicles; one station flies at most {COUNT_MAX}: divide its links"
            raise located(text, "stations", at, "links")
    without = [name for name in counts if name not in owners]
    if without:
        raise located(f"link {', '.join(without)} belongs to no station", "stations")


def _check_standby(at: int, station: StationSettings, counts: Mapping[str, int]) -> int:
    """Check what the station at this place stands by for. Returns: the number of these vehicles."""
    seen: set[str] = set()
    for number, standby in enumerate(station.standby):
        if standby.link not in counts or standby.link in station.links:
            others = ", ".join(name for name in counts if name not in station.links)
            raise located(f"a link of another station: {others}", "stations", at, "standby", number, "link")
        if standby.link in seen:
            raise located("it is there twice", "stations", at, "standby", number, "link")
        seen.add(standby.link)
    return sum(counts[link] for link in seen)
