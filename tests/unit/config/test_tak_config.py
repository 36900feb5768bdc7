"""The section `tak` of a configuration."""

from typing import Any

import pytest
from pydantic import ValidationError

from gcs.config.site import station_config
from gcs.links.features import TakSettings
from gcs.links.tak.settings import OwnTracks, TakReceiver
from gcs.model.frames import ShowFrame
from gcs.testing.virtual_show import show_config
from gcs.testing.virtual_site import site_config

PLACE = ShowFrame(47.3977, 8.5456, 488.0)


def settings(to: object = "udp://239.2.3.1:6969", **changes: object) -> TakSettings:
    return TakSettings.model_validate({"to": [to], "callsign": "LUCERNE", **changes})


def test_url_alone_is_a_receiver() -> None:
    (receiver,) = settings().to
    assert receiver == TakReceiver(at="udp://239.2.3.1:6969")
    (server,) = settings({"at": "tls://tak.example.org:8089", "certificate": "show.pem"}).to
    assert (server.at, str(server.certificate)) == ("tls://tak.example.org:8089", "show.pem")


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"to": "udp://239.2.3.1:0"}, "a port from 1 to 65535 is needed"),
        ({"to": "udp://239.2.3.1:65536"}, "out of range"),
        ({"to": "http://tak.example.org:8087"}, "String should match pattern"),
        ({"to": "udp://239.2.3.1"}, "String should match pattern"),
        ({"to": {"at": "udp://239.2.3.1:6969", "interface": "eth0"}}, "String should match pattern"),
        ({"to": {"interface": "192.0.2.7"}}, "Field required"),
        ({"to": {"at": "udp://239.2.3.1:6969", "track": "BOAT"}}, "Extra inputs"),
        ({"callsign": 'x" y'}, "String should match pattern"),
        ({"callsign": ""}, "String should match pattern"),
        ({"geoid_m": 400.0}, "less than or equal to 90"),
    ],
    ids=range(10),
)
def test_section_that_cannot_be_sent_is_refused(values: dict[str, Any], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        settings(**values)


def test_section_needs_receivers_and_a_callsign() -> None:
    for raw in ({"callsign": "LUCERNE"}, {"to": [], "callsign": "LUCERNE"}, {"to": ["udp://192.0.2.1:6969"]}):
        with pytest.raises(ValidationError):
            TakSettings.model_validate(raw)


def test_uid_is_that_of_one_show_at_one_place() -> None:
    other_place = ShowFrame(47.3978, 8.5456, 488.0)
    uids = {settings().uid(PLACE), settings(callsign="BERN").uid(PLACE), settings().uid(other_place)}
    assert len(uids) == 3
    assert settings(geoid_m=47.0).uid(PLACE) == settings("tcp://192.0.2.9:8087").uid(PLACE)


def test_stations_of_a_site_know_all_tracks_of_the_show() -> None:
    assert show_config(4).own_tracks == OwnTracks("", 0)
    site = site_config(2, 3, tak={"to": ["udp://192.0.2.1:6969"], "callsign": "LUCERNE"})
    north, south = (station_config(site, name).own_tracks for name in ("north", "south"))
    assert north == south == site.own_tracks
    assert north.number == 7, "with the centre"
