"""What the configuration of a site says of its stations: their vehicles, standbys, and what happens alone."""

from collections.abc import Mapping
from dataclasses import dataclass

from gcs.config.schema import Config
from gcs.model.setpoint_loss import WithoutSetpoints
from gcs.model.state import VehicleId
from gcs.preflight.parameters import presumed_parameters
from gcs.stations.site import StationFleet
from gcs.stations.space_without_control import WithoutControl


def station_fleets(site: Config) -> dict[str, StationFleet]:
    """The vehicles of each station of a site."""
    links = {link.name: link for link in site.links}
    fleets = {}
    for station in site.stations:
        own = [link.name for link in site.links if link.name in station.links]
        mirrored = [one.link for one in station.standby]
        vehicles = [one for name in (*own, *mirrored) for one in links[name].fleet]
        standby = sum(len(links[name].fleet) for name in mirrored)
        ids, charge = tuple(one.id for one in vehicles), tuple(one.charge for one in vehicles)
        fleets[station.name] = StationFleet(ids, charge, standby)
    return fleets


def without_setpoints(site: Config) -> dict[VehicleId, WithoutSetpoints]:
    """What each vehicle of a site does without setpoints, with the parameters that preflight requires."""
    operation, known = site.operation, presumed_parameters(site)
    action, loss_s = operation.setpoint_loss_action, operation.setpoint_loss_s
    return {
        each.id: profile.without_setpoints(action, loss_s, known.get(each.id, {}))
        for link in site.links
        for each, profile in zip(link.fleet, link.autopilots, strict=True)
    }


def without_control(site: Config) -> WithoutControl:
    """How vehicles of a site that no station controls are taken into account."""
    operation = site.operation
    return WithoutControl(
        operation.setpoint_loss_action,
        dict(zip(site.ids, site.return_heights_m.tolist(), strict=True)),
        operation.takeoff_height_m,
        without_setpoints(site),
        operation.silence_s,
        site.setpoint_timeout_s,
        site.control.telemetry_age_max_s,
    )


@dataclass(frozen=True, slots=True)
class SiteRoles:
    """Which vehicles are of which station, and which station takes over for which."""

    configured: Mapping[str, tuple[VehicleId, ...]]  # of the own links of each station
    standbys_of: Mapping[str, tuple[str, ...]]  # stations that take over vehicles of it
    stands_by: Mapping[str, tuple[VehicleId, ...]]  # vehicles that this station stands by for, by theirs

    @staticmethod
    def of(site: Config, station: str) -> "SiteRoles":
        """As `station` of the site sees it."""
        ids = {link.name: tuple(one.id for one in link.fleet) for link in site.links}
        owner = {link: each.name for each in site.stations for link in each.links}
        standbys: dict[str, list[str]] = {each.name: [] for each in site.stations}
        for each in site.stations:
            for owned_by in dict.fromkeys(owner[one.link] for one in each.standby):
                standbys[owned_by].append(each.name)
        mirrored = {one.link for each in site.stations if each.name == station for one in each.standby}
        stands_by: dict[str, tuple[VehicleId, ...]] = {}
        for link in site.links:
            if link.name in mirrored:
                stands_by[owner[link.name]] = stands_by.get(owner[link.name], ()) + ids[link.name]
        return SiteRoles(
            {
                each.name: tuple(
                    one for link in site.links if link.name in each.links for one in ids[link.name]
                )
                for each in site.stations
            },
            {name: tuple(others) for name, others in standbys.items()},
            stands_by,
        )
