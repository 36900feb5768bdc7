"""The configuration of one station, out of that of its site."""

from gcs.config.schema import Config
from gcs.config.stations import SiteRows
from gcs.links.features import StationInputs
from gcs.model.errors import ConfigError


def station_config(site: Config, name: str) -> Config:
    """That station's own configuration: its links, API, inputs and folder of records, and no `stations`.

    Raises: ConfigError with the names of the stations, for another name and for a site without stations.
    """
    station = next((each for each in site.stations if each.name == name), None)
    if station is None:
        names = ", ".join(each.name for each in site.stations) or "none in this configuration"
        raise ConfigError(f"there is no station '{name}'; stations: {names}")
    links = [link for link in site.links if link.name in station.links]
    named = {link.name: link for link in site.links}
    mirrors = [
        named[mirrored.link].model_copy(update={"listen": mirrored.listen}) for mirrored in station.standby
    ]
    ids = [vehicle.id for link in (*links, *mirrors) for vehicle in link.fleet]
    row_of = {vehicle: row for row, vehicle in enumerate(site.ids)}
    rows = tuple(row_of[vehicle] for vehicle in ids)
    places = {vehicle: place for vehicle, place in site.preflight.start_places.items() if vehicle in ids}
    record = site.record
    if record is not None:
        record = record.model_copy(update={"folder": record.folder / name})
    changes = {
        "links": (*links, *mirrors),
        "api": station.api or site.api,
        **{name: getattr(station, name) or getattr(site, name) for name in StationInputs.model_fields},
        "record": record,
        "preflight": site.preflight.model_copy(update={"start_places": places}),
        "stations": (),
        "site_rows": SiteRows(
            station=name,
            count=len(site.ids),
            rows=rows,
            standby=sum(len(link.fleet) for link in mirrors),
            mixed=len(set(site.autopilots.values())) > 1,
        ),
    }
    return Config.model_validate({key: getattr(site, key) for key in Config.model_fields} | changes)
