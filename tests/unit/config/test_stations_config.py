"""Stations of one site: what fits together, what is refused and where, and each one's own configuration."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from gcs.config.schema import Config, find, load, parse
from gcs.config.site import station_config
from gcs.model.errors import ConfigError

SITE = find("stations").read_text(encoding="utf-8")


def changed(change: Callable[[dict[str, Any]], object]) -> str:
    """The shipped site after `change`, as YAML."""
    raw = yaml.safe_load(SITE)
    change(raw)
    text: str = yaml.safe_dump(raw, sort_keys=False)
    return text


def refusal(change: Callable[[dict[str, Any]], object]) -> str:
    with pytest.raises(ConfigError) as refused:
        parse(changed(change), "site.yaml")
    return str(refused.value)


def site_of(change: Callable[[dict[str, Any]], object]) -> Config:
    return parse(changed(change), "site.yaml")


def set_at(*path: str | int, value: object) -> Callable[[dict[str, Any]], None]:
    def change(raw: dict[str, Any]) -> None:
        at: Any = raw
        for part in path[:-1]:
            at = at[part]
        at[path[-1]] = value

    return change


def remote(raw: dict[str, Any], **bus: object) -> None:
    """Each station on a host of its own."""
    raw["bus"] |= bus
    for number, station in enumerate(raw["stations"]):
        station["endpoint"] = {"host": f"10.0.0.{number + 1}", "port": 7447}


@pytest.mark.parametrize(
    ("change", "reported"),
    [
        (lambda raw: raw["stations"].__delitem__(slice(1, 4)), "stations: 2 to 100 are possible, not 1"),
        (set_at("stations", 1, "name", value="north"), "stations.1.name = 'north': another station has"),
        (set_at("stations", 1, "name", value="a b"), "stations.1.name = 'a b'"),
        (set_at("stations", 1, "name", value="x" * 33), "stations.1.name"),
        (
            set_at("stations", 2, "links", value=["nowhere"]),
            "stations.2.links.0 = 'nowhere': one of the links north-radio, east-radio",
        ),
        (
            set_at("stations", 2, "links", value=["north-radio"]),
            "stations.2.links.0 = 'north-radio': north has this link",
        ),
        (
            set_at("stations", 2, "links", value=["south-radio", "south-radio"]),
            "stations.2.links.1 = 'south-radio': south has this link",
        ),
        (
            set_at("stations", 2, "links", value=[]),
            "stations.2.links: at least one link, of its own or on standby",
        ),
        (
            lambda raw: raw["stations"].pop(),
            "stations: link west-radio belongs to no station",
        ),
        (
            set_at("stations", 3, "endpoint", "port", value=7441),
            "stations.3.endpoint.port = 7441: north has this endpoint",
        ),
        (
            set_at("stations", 3, "endpoint", value={"host": "localhost", "port": 7441}),
            "stations.3.endpoint.port = 7441: north has this endpoint",
        ),
        (
            set_at("stations", 3, "endpoint", "host", value="10.0.0.4"),
            "stations.3.endpoint.host = '10.0.0.4': beyond 127.0.0.1 certificates are needed",
        ),
        (
            set_at("stations", 3, "endpoint", "host", value="tcp/x"),
            "stations.3.endpoint.host = 'tcp/x': a host name or an address",
        ),
        (
            set_at("stations", 3, "endpoint", "host", value="0.0.0.0"),  # noqa: S104 (what is refused)
            "stations.3.endpoint.host = '0.0.0.0': an address under which the others reach it",
        ),
        (set_at("stations", 3, "endpoint", "port", value=0), "stations.3.endpoint.port = 0: at least 1"),
        (
            set_at("stations", 3, "api", "port", value=8001),
            "stations.3.api.port = 8001: port 8001 is north's, on the same machine",
        ),
        (
            lambda raw: [station.pop("api") for station in raw["stations"]],
            "stations.1.name = 'east': port 800",
        ),
        (
            set_at("stations", 3, "endpoint", "port", value=8001),
            "stations.3.endpoint.port = 8001: port 8001 is that of north's API",
        ),
        (
            set_at("timecode", value={"source": "udp-midi://127.0.0.1:5006"}),
            "stations.1.name = 'east': north receives timecode at udp-midi://127.0.0.1:5006 as well",
        ),
        (
            lambda raw: [one.update(timecode={"source": "midi:///dev/midi"}) for one in raw["stations"][2:]],
            "stations.3.timecode.source = 'midi:///dev/midi': south receives timecode",
        ),
        (set_at("bus", "lease_s", value=0.01), "bus.lease_s = 0.01: at least 0.1"),
        (set_at("bus", "lead_silent_s", value=0), "bus.lead_silent_s = 0: at least 0.5"),
        (set_at("bus", "lease", value=0.2), "bus.lease = 0.2: unknown key; did you mean lease_s?"),
        (set_at("formation", "radius_m", value=5.0), "formation.radius_m = 5.0: at least 5.6 m for 16"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_place(
    change: Callable[[dict[str, Any]], object], reported: str
) -> None:
    stated = refusal(change)
    assert reported in stated
    assert stated.startswith("site.yaml: line ")


def test_at_most_100_stations_and_1200_vehicles_of_each() -> None:
    def many(raw: dict[str, Any]) -> None:
        raw["formation"] = {"radius_m": 80.0, "height_m": 100.0}
        raw["control"] = {"safety": {"fence": {"height_max_m": 300.0, "distance_max_m": 400.0}}}
        for number in range(5):
            link: dict[str, object] = {"name": f"more{number}", "transport": "native"}
            link |= {"listen": f"udpin://127.0.0.1:{16000 + number}"}
            link["vehicles"] = {"first_system_id": 1, "count": 239, "id_pattern": "{link}x{system_id}"}
            raw["links"].append(link)
            raw["stations"][0]["links"].append(link["name"])

    assert len(station_config(site_of(many), "north").ids) == 1199

    def one_more(raw: dict[str, Any]) -> None:
        many(raw)
        vehicles = {"first_system_id": 1, "count": 239, "id_pattern": "{link}x{system_id}"}
        link = {"name": "last", "listen": "udpin://127.0.0.1:16010", "vehicles": vehicles}
        raw["links"].append(link)
        raw["stations"][0]["links"].append("last")

    assert "stations.0.links: 1438 vehicles; one station flies at most 1200" in refusal(one_more)

    def crowded(raw: dict[str, Any]) -> None:
        names = [f"s{number}" for number in range(104)]
        raw["stations"] = [
            {"name": name, "links": [name], "endpoint": {"host": "::1", "port": 7000 + number}}
            for number, name in enumerate(names)
        ]

    assert "stations: 2 to 100 are possible, not 104" in refusal(crowded)


def test_stations_on_hosts_of_their_own_may_use_the_same_ports() -> None:
    def change(raw: dict[str, Any]) -> None:
        remote(raw, keys="keys")
        for station, link in zip(raw["stations"], raw["links"], strict=True):
            del station["api"]
            link["listen"] = "udpin://0.0.0.0:14540"

    site = site_of(change)
    assert [station_config(site, each.name).api.port for each in site.stations] == [8000] * 4
    assert site.bus.keys == Path("keys")


def test_links_on_one_machine_may_not_use_the_same_port() -> None:
    change = set_at("links", 1, "listen", value="udpin://127.0.0.1:15100")
    assert "links: east-radio and north-radio both listen on 127.0.0.1:15100" in refusal(change)


def test_api_of_a_station_beyond_loopback_needs_tokens() -> None:
    def change(raw: dict[str, Any]) -> None:
        remote(raw, keys="keys")
        raw["stations"][1]["api"] = {"host": "10.0.0.2"}

    assert "stations.1.api.host = 10.0.0.2: beyond 127.0.0.1 tokens are needed" in refusal(change)


def test_a_station_has_its_own_links_api_and_records() -> None:
    def change(raw: dict[str, Any]) -> None:
        raw["record"] = {"folder": "runs", "frames": False}
        raw["preflight"] = {"start_places": {"n1": {"x_m": 0, "y_m": 0}, "e1": {"x_m": 4, "y_m": 0}}}

    site = site_of(change)
    east = station_config(site, "east")
    assert east.ids == ("e1", "e2", "e3", "e4")
    assert [link.name for link in east.links] == ["east-radio"]
    assert (east.api.port, east.stations) == (8010, ())
    assert east.record is not None
    assert (east.record.folder, east.record.frames) == (Path("runs/east"), False)
    assert list(east.preflight.start_places) == ["e1"]
    for same in ("formation", "bus", "show_frame", "control", "operation", "failsafes"):
        assert getattr(east, same) == getattr(site, same)
    assert Config.model_validate_json(east.model_dump_json()) == east


def test_a_station_has_the_timecode_of_the_file_or_its_own() -> None:
    def change(raw: dict[str, Any]) -> None:
        remote(raw, keys="keys")
        raw["timecode"] = {"source": "rtp-midi://10.1.0.1:5004"}
        raw["stations"][1]["timecode"] = {"source": "midi:///dev/midi"}

    site = site_of(change)
    found = [station_config(site, each.name).timecode for each in site.stations]
    sources = [None if one is None else one.source for one in found]
    assert sources == ["rtp-midi://10.1.0.1:5004", "midi:///dev/midi", *["rtp-midi://10.1.0.1:5004"] * 2]


def test_return_heights_are_layered_over_the_whole_site() -> None:
    site = load(find("stations"))
    own = [station_config(site, station.name) for station in site.stations]
    assert np.concatenate([each.return_heights_m for each in own]).tolist() == site.return_heights_m.tolist()
    assert len(set(site.return_heights_m.tolist())) == 16


def test_the_order_of_a_stations_links_is_that_of_the_file() -> None:
    def change(raw: dict[str, Any]) -> None:
        raw["stations"].pop(2)
        raw["stations"][0]["links"] = ["south-radio", "north-radio"]

    north = station_config(site_of(change), "north")
    assert north.ids == ("n1", "n2", "n3", "n4", "s1", "s2", "s3", "s4")
    assert north.site_rows is not None
    assert north.site_rows.rows == (0, 1, 2, 3, 8, 9, 10, 11)


def test_an_unknown_station_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="no station 'nord'; stations: north, east, south, west"):
        station_config(load(find("stations")), "nord")
    with pytest.raises(ConfigError, match="stations: none in this configuration"):
        station_config(load(find("demo")), "north")


@pytest.mark.soak
@pytest.mark.long
def test_without_stations_zenoh_is_never_imported() -> None:
    code = (
        "import sys, gcs.cli.service.serve, gcs.cli.params, gcs.flight.orchestrator, gcs.config.site\n"
        "from gcs.config.schema import find, load\n"
        "load(find('demo')), load(find('stations'))\n"
        "print(*sys.modules)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert (
        set(result.stdout.split()) & {"zenoh", "cryptography", "gcs.bus.zenoh_bus", "gcs.bus.keys"} == set()
    )
