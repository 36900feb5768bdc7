"""What one station knows of the others."""

from typing import Any

import numpy as np
import pytest

from gcs.formation.orbit import Center
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.stations.lead import SiteLead
from gcs.stations.messages import (
    PHASE_CODE,
    BatchHead,
    Echo,
    FormationMessage,
    SlotsMessage,
    VelocitiesMessage,
)
from gcs.stations.site import LOST_S, SHARES_S, Site, StationFleet
from gcs.stations.space_without_control import WithoutControl
from tests.unit.stations.test_messages import HEAD, batch

FLEETS = {
    "north": StationFleet(("n1", "n2"), (1.0, 1.0)),
    "south": StationFleet(("s1", "s2", "s3"), (1.0, 2.0, 1.0)),
    "west": StationFleet(("w1",), (1.0,)),
}


def site(own: str = "north") -> Site:
    return Site(own, FLEETS, WithoutControl(action="land"))


def head(of: Site, **changed: Any) -> BatchHead:
    usual = HEAD._replace(site=of.site, term=1, lead=0, echoes=())
    return usual._replace(**changed)


def from_south(of: Site, about: BatchHead | None = None, **changed: Any) -> bytes:
    flying = np.ones(3, np.bool_)
    usual = batch(3, about or head(of))._replace(
        age_s=np.full(3, 0.1),
        position_m=np.array([[0.0, 0.0, -20.0], [10.0, 0.0, -20.0], [20.0, 0.0, -20.0]]),
        velocity_m_s=np.tile([2.0, 0.0, 0.0], (3, 1)),
        desired_m_s=np.tile([2.0, 0.0, 0.0], (3, 1)),
        setpoint_m_s=np.tile([2.0, 0.0, 0.0], (3, 1)),
        phases=np.full(3, PHASE_CODE[Phase.FORMATION], np.uint8),
        airborne=flying,
        formed=flying,
        owned=flying,
        epochs=np.ones(3, np.uint8),
    )
    return usual._replace(**changed).encode()


def test_vehicles_are_brought_forward_from_the_batch() -> None:
    north = site()
    north.receive("south", "states", from_south(north), 100.0)
    seen = north.others(100.2)
    assert seen.ids == ("s1", "s2", "s3", "w1")
    assert seen.position_m[0] == pytest.approx([0.4, 0.0, -20.0], abs=0.01)
    assert seen.formed.tolist() == [True, True, True, False]
    assert seen.charge.tolist() == [1.0, 2.0, 1.0, 1.0]
    assert np.isnan(seen.position_m[3]).all()


def test_old_batch_makes_vehicles_less_certain() -> None:
    north = site()
    north.receive("south", "states", from_south(north, uncertainty_m=np.full(3, 0.1)), 100.0)
    new_m, old_m = (north.others(now_s).uncertainty_m[:3] for now_s in (100.0, 100.2))
    assert new_m == pytest.approx(0.1)
    assert old_m == pytest.approx(np.hypot(0.1, 0.06))  # it may have changed its velocity by 0.6 m/s


@pytest.mark.parametrize(
    ("held_s", "later_s", "shares"),
    [
        (0.05, 0.05, True),
        (SHARES_S + 0.01, 0.05, False),  # it does not hear of the own vehicles any more
        (0.05, SHARES_S + 0.01, False),
        (None, 0.05, False),
    ],
)
def test_station_shares_only_while_both_hear_each_other(
    held_s: float | None, later_s: float, shares: bool
) -> None:
    north = site()
    echoes = () if held_s is None else (Echo(0, 1, held_s),)
    unfiltered_m_s = np.array([[3.0, 0.0, 0.0], [np.nan] * 3, [3.0, 0.0, 0.0]])
    desired_m_s = np.where(np.isfinite(unfiltered_m_s), 1.0, np.nan)  # the second is not commanded
    age_s = np.array([0.1, 0.1, 0.6])  # the third is silent: its own station does not command it
    sent = from_south(
        north,
        head(north, echoes=echoes),
        unfiltered_m_s=unfiltered_m_s,
        desired_m_s=desired_m_s,
        setpoint_m_s=desired_m_s,
        age_s=age_s,
    )
    north.receive("south", "states", sent, 100.0)
    seen = north.others(100.0 + later_s)
    assert np.isfinite(seen.unfiltered_m_s[:, 0]).tolist() == [shares, False, False, False]
    assert not shares or seen.unfiltered_m_s[0].tolist() == [3.0, 0.0, 0.0]


def test_silent_station_is_lost_and_its_space_closed() -> None:
    north = site()
    north.receive("south", "states", from_south(north), 100.0)
    assert north.lost(100.0 + LOST_S - 0.01) == []
    assert north.lost(100.0 + LOST_S + 0.01) == ["south"]
    seen = north.others(100.0 + LOST_S + 0.01)
    assert not seen.formed.any()
    assert seen.airborne.tolist() == [True, True, True, False]
    assert set(seen.segments_of.tolist()) == {0, 1, 2}
    later = north.others(103.0)  # lost for good: they land where they can have drifted to
    lowest_m = [-later.segments_m[later.segments_of == row][..., 2].max() for row in range(3)]
    assert lowest_m == pytest.approx([0.0, 0.0, 0.0])
    north.receive("south", "states", from_south(north), 104.0)  # it is back
    assert len(north.others(104.1).segments_m) == 0


def test_places_to_land_allow_for_a_lost_station_at_once() -> None:
    """A return that was planned within their first 2 s led vehicles below them."""
    north = site()
    north.receive("south", "states", from_south(north), 100.0)
    assert len(north.closed(100.0 + LOST_S - 0.01)[0]) == 0
    now_s = 100.0 + LOST_S + 0.01
    closed_m, rows = north.closed(now_s)
    assert set(rows.tolist()) == {0, 1, 2}
    assert [-closed_m[rows == row][..., 2].max() for row in range(3)] == pytest.approx([0.0] * 3)
    assert north.others(now_s).segments_m[..., 2].max() < -10.0  # in flight the ground is open until then
    np.testing.assert_array_equal(closed_m, north.others(103.0).segments_m)
    north.receive("south", "states", from_south(north, age_s=np.full(3, 1.0)), 104.0)
    assert len(north.closed(104.1)[0]) == 0  # back, and only silent


def test_vehicle_that_its_station_lost_is_closed_for_all() -> None:
    north = site()
    phases = np.array([PHASE_CODE[Phase.FORMATION], PHASE_CODE[Phase.LOST], PHASE_CODE[Phase.KILLED]])
    north.receive("south", "states", from_south(north, phases=phases.astype(np.uint8)), 100.0)
    assert set(north.others(100.05).segments_of.tolist()) == {1, 2}


def test_delay_is_half_of_the_round_trip() -> None:
    north, south = site(), site("south")
    offset_s = 5000.0  # the clocks of two hosts have nothing in common
    for step in range(50):
        now_s = 100.0 + 0.1 * step
        sequence, echoes = north.next_sequence(now_s)
        south.receive("north", "states", from_north(north, sequence, echoes), now_s + 0.03 + offset_s)
        sequence, echoes = south.next_sequence(now_s + 0.04 + offset_s)
        back = from_south(north, head(north, sequence=sequence, echoes=echoes))
        north.receive("south", "states", back, now_s + 0.07)
    assert north.delays.one_way_s(1) == pytest.approx(0.03, abs=0.001)
    assert south.delays.one_way_s(0) == pytest.approx(0.03, abs=0.001)


def from_north(of: Site, sequence: int, echoes: object) -> bytes:
    return batch(2, head(of, sequence=sequence, echoes=echoes)).encode()


@pytest.mark.parametrize("sender", ["north", "east", ""])
def test_messages_of_no_other_station_are_refused(sender: str) -> None:
    north = site()
    north.receive(sender, "states", from_south(north), 100.0)
    assert north.refused == 1
    assert north.present(100.0) == []


def test_batch_of_another_site_is_refused() -> None:
    north = site()
    north.receive("south", "states", from_south(north, head(north, site=north.site + 1)), 100.0)
    north.receive("west", "states", from_south(north), 100.0)  # too many vehicles
    assert north.refused == 2


def formation(of: Site, term: int, lead: int) -> bytes:
    center = Center(np.array([0.0, 0.0, -30.0]), np.array([1.0, 0.0, 0.0]), np.zeros(3))
    return FormationMessage(of.site, term, lead, 5, ShowPhase.RUNNING, center, 12.0, 0.0, {}).encode()


def test_follower_knows_the_formation_of_the_lead_only() -> None:
    south = site("south")
    south.receive("west", "formation", formation(south, 1, 2), 100.0)
    assert south.formation(100.1, 1.0) is None  # west does not lead
    south.receive("north", "formation", formation(south, 1, 0), 100.0)
    place = np.tile([0.0, 0.6, 0.8], (3, 1))
    slots = SlotsMessage(south.site, 1, 0, place).encode()
    south.receive("north", "slots.south", slots, 100.0)
    known = south.formation(100.1, 1.0)
    assert known is not None
    assert known.center is not None
    assert known.center.position_m == pytest.approx([0.1, 0.0, -30.0])
    assert known.place[:3] == pytest.approx(place, abs=1e-4)
    assert np.isnan(known.place[3:]).all()
    assert south.plan_version() == 5
    assert south.formation(101.5, 1.0) is None  # the lead is silent


def test_velocities_of_the_lead_are_flown_for_a_quarter_second() -> None:
    south, sent_m_s = site("south"), np.array([[1.0, 0.0, -2.0], [0.5, 0.5, 0.0], [np.nan] * 3])
    of_north = VelocitiesMessage(south.site, 1, 0, sent_m_s).encode()
    south.receive("north", "formation", formation(south, 1, 0), 100.0)
    south.receive("west", "velocities.south", VelocitiesMessage(south.site, 1, 2, sent_m_s).encode(), 100.0)
    south.receive(
        "north", "velocities.south", VelocitiesMessage(south.site, 1, 0, sent_m_s[1:]).encode(), 100.0
    )
    south.receive("north", "velocities.west", of_north, 100.0)
    led = south.formation(100.1, 1.0)
    assert led is not None
    assert led.led_m_s is None, "west does not lead, two rows are too few, the third is for west"
    assert south.refused == 2
    south.receive("north", "velocities.south", of_north, 100.1)
    led = south.formation(100.3, 1.0)
    assert led is not None
    assert led.led_m_s is not None
    assert led.led_m_s[:3] == pytest.approx(sent_m_s, nan_ok=True)
    assert np.isnan(led.led_m_s[3:]).all()
    led = south.formation(100.4, 1.0)
    assert led is not None
    assert led.led_m_s is None


def test_highest_term_leads_and_the_name_decides_within_one() -> None:
    names = ("north", "south", "west")
    leads = {name: SiteLead(name, names) for name in names}
    assert [leads[name].leads for name in names] == [True, False, False]
    leads["south"].take()
    leads["west"].take()  # both operators at once
    for lead in leads.values():
        for other in leads.values():
            lead.observe(other.term, other.number)
    assert [leads[name].leads for name in names] == [False, False, True]
    assert {lead.term for lead in leads.values()} == {2}
    assert not leads["north"].obeys(2, 1)
    leads["north"].take()
    assert leads["north"].term == 3
    leads["west"].observe(3, 0)
    assert not leads["west"].leads


def test_first_term_is_the_first_stations() -> None:
    lead = SiteLead("north", ("north", "south"))
    assert not lead.observe(1, 1)
    assert not lead.observe(9, 7)  # no such station
    assert lead.leads


MIRRORED = {
    "north": StationFleet(("n1", "n2"), (1.0, 1.0)),
    "south": StationFleet(("s1", "n1", "n2"), (1.0, 1.0, 1.0), standby=2),
    "west": StationFleet(("w1",), (1.0,)),
}


def claimed(of: Site, count: int, owned: list[bool], epochs: list[int]) -> bytes:
    usual = batch(count, head(of))
    where_m = np.tile([5.0, 0.0, -20.0], (count, 1))
    seen = usual._replace(position_m=where_m, age_s=np.full(count, 0.1))
    return seen._replace(owned=np.array(owned), epochs=np.array(epochs, np.uint8)).encode()


def test_standby_takes_over_with_a_higher_epoch() -> None:
    north, south, west = (Site(name, MIRRORED, WithoutControl()) for name in MIRRORED)
    assert south.owned.tolist() == [True, False, False]
    assert west.ids == ("n1", "n2", "s1")
    south.receive("north", "states", claimed(south, 2, [True, True], [1, 1]), 100.0)
    west.receive("north", "states", claimed(west, 2, [True, True], [1, 1]), 100.0)
    west.receive("south", "states", claimed(west, 3, [True, False, False], [1, 0, 0]), 100.0)
    assert west.owners == ["north", "north", "south"]
    assert np.isfinite(south.others(100.1).position_m[:2]).all()
    assert south.take_over("north") == ["n1", "n2"]
    assert south.epochs.tolist() == [1, 2, 2]
    assert np.isnan(south.others(100.1).position_m[:2]).all()  # its own rows have them now
    for site in (north, west):
        site.receive("south", "states", claimed(site, 3, [True, True, True], [1, 2, 2]), 101.0)
        site.receive("north", "states", claimed(site, 2, [True, True], [1, 1]), 101.1)  # too late
    assert west.owners == ["south", "south", "south"]
    assert north.owned.tolist() == [False, False]
    assert south.take_over("north") == []


def test_vehicles_that_are_given_back_are_owned_again() -> None:
    north, south, west = (Site(name, MIRRORED, WithoutControl()) for name in MIRRORED)
    for site in (north, west):
        site.receive("south", "states", claimed(site, 3, [True, True, True], [1, 2, 2]), 101.0)
    south.receive("north", "states", claimed(south, 2, [True, True], [1, 1]), 100.0)
    south.take_over("north")
    south.give_back({"n1", "n2"})
    assert south.owned.tolist() == [True, False, False]
    for site in (north, west):
        site.receive("south", "states", claimed(site, 3, [True, False, False], [1, 2, 2]), 102.0)
    assert north.owned.tolist() == [True, True]
    assert north.epochs.tolist() == [3, 3]
    for site in (south, west):
        site.receive("north", "states", claimed(site, 2, [True, True], [3, 3]), 103.0)
    assert west.owners == ["north", "north", "south"]
    assert south.owners[:2] == ["north", "north"]


def test_display_shows_every_vehicle_once() -> None:
    south = Site("south", MIRRORED, WithoutControl())
    n = len(south.own_ids)
    names = [*south.own_ids, *south.ids]
    assert sorted(names[row] for row in south.shown.tolist()) == ["n1", "n2", "s1", "w1"]
    assert [row >= n for row in south.shown.tolist()] == [False, True, True, True]
    south.receive("north", "states", claimed(south, 2, [True, True], [1, 1]), 100.0)
    south.take_over("north")
    assert [row >= n for row in south.shown.tolist()] == [False, False, False, True]
