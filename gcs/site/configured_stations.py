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
        mirrored = [standby.link for standby in station.standby]
        vehicles = [vehicle for name in (*own, *mirrored) for vehicle in links[name].fleet]
        standby = sum(len(links[name].fleet) for name in mirrored)
        ids, charge = tuple(vehicle.id for vehicle in vehicles), tuple(vehicle.charge for vehicle in vehicles)
        fleets[station.name] = StationFleet(ids, charge, standby)
    return fleets


def without_setpoints(site: Config) -> dict[VehicleId, WithoutSetpoints]:
    """What each vehicle of a site does without setpoints, with the parameters that preflight requires."""
    operation, presumed = site.operation, presumed_parameters(site)
    action, loss_s = operation.setpoint_loss_action, operation.setpoint_loss_s
    return {
        each.id: profile.without_setpoints(action, loss_s, presumed.get(each.id, {}))
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
    stands_by_for: Mapping[str, tuple[VehicleId, ...]]  # vehicles that this station may take over, by station

    @staticmethod
    def of(site: Config, station: str) -> "SiteRoles":
        """As `station` of the site sees it."""
        fleets, links = station_fleets(site), {link.name: link for link in site.links}
        owner = {link: each.name for each in site.stations for link in each.links}
        standbys_of: dict[str, tuple[str, ...]] = dict.fromkeys(fleets, ())
        stands_by_for: dict[str, tuple[VehicleId, ...]] = {}
        for each in site.stations:
            for name in dict.fromkeys(owner[standby.link] for standby in each.standby):
                standbys_of[name] += (each.name,)
            for standby in each.standby if each.name == station else ():
                ids = tuple(vehicle.id for vehicle in links[standby.link].fleet)
                stands_by_for[owner[standby.link]] = stands_by_for.get(owner[standby.link], ()) + ids
        configured = {name: fleet.ids[: len(fleet.ids) - fleet.standby] for name, fleet in fleets.items()}
        return SiteRoles(configured, standbys_of, stands_by_for)
