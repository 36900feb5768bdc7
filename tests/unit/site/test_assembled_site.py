"""Which station says that the formation of a site is assembled."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.config.site import station_config
from gcs.control import Memory
from gcs.flight.features.timecode import Timecode
from gcs.flight.state.flight import Flight
from gcs.formation.orbit import Center
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.site.member import Membership, SiteMember
from gcs.stations.site import LOST_S, Site
from gcs.testing.memory_bus import network
from gcs.testing.virtual_site import site_config
from tests.support.silent_link import SilentLink
from tests.unit.stations.test_messages import HEAD, batch


def side_by_side(station: str) -> tuple[Flight, SiteMember]:
    """A station with two vehicles that fly in formation, and stand close together."""
    site = site_config(2, 2)
    own = station_config(site, station)
    flight = Flight(own, [SilentLink(own.ids)], 0.0)
    flight.outside_clock = Timecode(None)
    bus = network(("north", "south"), lambda: 0.0).bus(station)
    flight.elsewhere = member = SiteMember(flight, Membership(station, site, bus, 1))
    for vehicle in flight.vehicles.values():
        vehicle.phase = Phase.FORMATION
    position_m = np.array([[8.0, 0.0, -20.0], [8.0, 0.5, -20.0]])
    flight.newest.state = replace(flight.newest.state, position_m=position_m)
    center = Center.at_rest(np.array([0.0, 0.0, -20.0]))
    flight.newest.memory = replace(Memory.fresh(4, 0.0), center=center, radius_m=8.0)
    return flight, member


def reports(of: Site, show: ShowPhase) -> bytes:
    head = HEAD._replace(site=of.site, term=1, lead=0, echoes=(), show=show)
    nowhere = np.zeros(2, np.bool_)
    return batch(2, head)._replace(formed=nowhere, owned=~nowhere).encode()


@pytest.mark.parametrize(("show", "assembled"), [(ShowPhase.RUNNING, True), (ShowPhase.ASSEMBLING, False)])
def test_follower_takes_it_from_the_lead(show: ShowPhase, assembled: bool) -> None:
    """By its own look a formation that passes lost vehicles is never spread evenly."""
    flight, member = side_by_side("south")
    assert not flight.assembled()
    member.site.receive("north", "states", reports(member.site, show), 0.0)
    assert flight.assembled() is assembled
    flight.newest.state = replace(
        flight.newest.state, time_s=LOST_S + 0.1
    )  # the lead is not received any more
    assert not flight.assembled()


def test_lead_looks_for_itself() -> None:
    flight, member = side_by_side("north")
    member.site.receive("south", "states", reports(member.site, ShowPhase.RUNNING), 0.0)
    assert not flight.assembled()
