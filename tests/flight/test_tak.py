"""Vehicles and centre as tracks of TAK in flight: each once a second, if its place is believed."""

from math import nan

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.model.lifecycle import Phase
from gcs.service.alarms import AlarmCause
from gcs.service.features import TakView
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from gcs.testing.virtual_site import SiteShow, fly_site, site_config
from tests.support.show_phases import running
from tests.support.tak_listener import Listening, TakEvent

TAK = {"to": ["udp://192.0.2.9:6969"], "callsign": "LUCERNE", "geoid_m": 47.0}
FOUR = show_config(4, tak=TAK)
NAMES = [f"LUCERNE d{at}" for at in range(1, 5)]


def off_m(show: VirtualShow, track: TakEvent, place_m: np.ndarray) -> float:
    """How far a track is from a place in the show frame."""
    latitude_deg, longitude_deg, hae_m = track.place
    degrees = np.array([latitude_deg]), np.array([longitude_deg]), np.array([hae_m - 47.0])
    return float(np.linalg.norm(show.config.frame.position_m(*degrees)[0] - place_m))


def view(show: VirtualShow) -> TakView:
    reported = show.view.features.tak
    assert reported is not None
    return reported


def test_each_vehicle_and_the_centre_are_sent_once_a_second() -> None:
    async def story(show: VirtualShow) -> None:
        listener = Listening.to(show.service).listener
        await show.wait(10.0)
        newest = listener.events[-5:]
        assert [each.callsign for each in newest] == ["LUCERNE", *NAMES], "in one tick"
        for name in ("LUCERNE", *NAMES):
            assert np.allclose(np.diff(listener.times_s(name)), 1.0, atol=0.001)
            assert len(listener.times_s(name)) == 10
        assert len({each.of(".", "uid") for each in listener.events}) == 5
        for row, track in enumerate(newest[1:]):
            assert track.unix_s("time") == pytest.approx(show.service.flight.unix_s(), abs=1.0)
            assert track.of(".", "how") == "m-g"
            assert off_m(show, track, show.true_m[row]) < 6.0, "it moves, and errs by less than a metre"
            assert float(track.of("point", "ce")) > 0.0
            assert track.event.findtext("detail/remarks", "").startswith("formation, ")
        center = newest[0]
        assert (center.of(".", "how"), center.of("point", "ce")) == ("m-f", "9999999.0")
        assert off_m(show, center, np.array(show.view.center_m)) < 3.0
        assert (view(show).vehicles, view(show).missing) == (4.0, "")

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_vehicle_that_is_silent_or_without_a_fix_is_not_sent() -> None:
    async def story(show: VirtualShow) -> None:
        listener = Listening.to(show.service).listener
        await show.wait(3.0)
        silent_s = show.now_s
        show.ports.silence("d3")
        show.befall("d2", "fix", type="no-gps")
        await show.wait(6.0)
        assert view(show).missing == "d2, d3"
        assert show.vehicle("d3").phase is Phase.LOST
        assert max(listener.times_s("LUCERNE d3")) < silent_s + 1.0
        assert max(listener.times_s("LUCERNE d2")) < silent_s + 2.0
        assert max(listener.times_s("LUCERNE d1")) > silent_s + 4.5
        show.ports.restore("d3")
        await show.wait(4.0)
        assert max(listener.times_s("LUCERNE d3")) > silent_s + 7.0
        assert view(show).missing == "d2"

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_no_centre_on_the_ground_and_no_height_without_a_geoid() -> None:
    async def story(show: VirtualShow) -> None:
        listener = Listening.to(show.service).listener
        await show.standby()
        await show.wait(3.0)
        assert {each.callsign for each in listener.events} == {"LUCERNE d1", "LUCERNE d2"}
        assert {each.of("point", "hae") for each in listener.events} == {"9999999.0"}
        assert {each.of("point", "le") for each in listener.events} == {"9999999.0"}

    fly(story, show_config(2, tak={name: value for name, value in TAK.items() if name != "geoid_m"}))


@pytest.mark.soak
@pytest.mark.parametrize("required", [True, False])
def test_without_a_clock_tracks_are_sent_only_if_allowed(required: bool) -> None:
    async def story(show: VirtualShow) -> None:
        listening = Listening.to(show.service)
        listening.tak._unix_minus_loop_s = lambda: nan
        await show.wait(6.0)
        (reported,) = view(show).receivers
        assert ("not synchronised" in reported.problem) == required
        assert bool(listening.listener.events) != required
        (alarm,) = [each for each in show.view.alarms if each.cause is AlarmCause.TAK_NOT_SENT]
        assert ("not synchronised" in alarm.text) == required, "else it is not connected in virtual time"

    fly(story, show_config(4, tak={**TAK, "require_clock": required}), after=running)


@pytest.mark.soak
def test_fleet_beyond_the_share_of_a_tick_is_spread_over_several() -> None:
    async def story(show: VirtualShow) -> None:
        tak = Listening.to(show.service).tak
        tak._at_once = 2
        listener = tak.senders[0]
        await show.wait(2.5)
        times_s = {name: listener.times_s(name) for name in NAMES}  # type: ignore[attr-defined]
        assert all(np.allclose(np.diff(each), 1.0, atol=0.001) for each in times_s.values())
        assert times_s["LUCERNE d3"][0] - times_s["LUCERNE d1"][0] == pytest.approx(0.05, abs=0.001)

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_each_station_sends_its_own_and_the_lead_the_centre() -> None:
    site: Config = site_config(2, 2, formation={"radius_m": 8.0, "height_m": 14.0}, tak=TAK)

    async def story(show: SiteShow) -> None:
        listeners = {name: Listening.to(show[name].service.local).listener for name in ("north", "south")}
        await show.start()
        await show.wait(5.0)
        sent = {name: {each.callsign for each in each_.events} for name, each_ in listeners.items()}
        assert sent["north"] == {"LUCERNE", "LUCERNE n1", "LUCERNE n2"}
        assert sent["south"] == {"LUCERNE s1", "LUCERNE s2"}
        uids = {name: {each.of(".", "uid") for each in each_.events} for name, each_ in listeners.items()}
        own = {show[name].config.own_tracks for name in listeners}
        assert len(own) == 1, "each station knows the tracks of the others"
        (own_tracks,) = own
        assert own_tracks.number == 5
        assert all(uid.startswith(own_tracks.uid) for each in uids.values() for uid in each)

    fly_site(story, site)
