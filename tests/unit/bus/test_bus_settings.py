"""Endpoints as Zenoh writes them, and the configuration that it is given."""

import json
from itertools import combinations
from pathlib import Path

import pytest
from pydantic import ValidationError

from gcs.bus.keys import make_site_keys
from gcs.bus.settings import BusSettings, Endpoint
from gcs.bus.zenoh_config import configuration
from gcs.model.errors import LinkError

ENDPOINTS = {name: Endpoint(host="127.0.0.1", port=7400 + k) for k, name in enumerate(("north", "south"))}


def test_an_endpoint_is_written_as_zenoh_reads_it() -> None:
    assert Endpoint(host="10.0.0.1", port=7400).url(tls=True) == "tls/10.0.0.1:7400"
    assert Endpoint(host="fd00::1", port=7400).url(tls=False) == "tcp/[fd00::1]:7400"
    assert Endpoint(host="::1", port=1).is_loopback
    assert not Endpoint(host="10.0.0.1", port=1).is_loopback


@pytest.mark.parametrize("host", ["", "a/b", "a#b", "a;b", "a b", "a,b", "a?b"])
def test_a_host_that_would_change_the_url_is_refused(host: str) -> None:
    with pytest.raises(ValidationError, match="a host name or an address"):
        Endpoint(host=host, port=7400)


def test_a_lease_is_at_least_a_tenth_of_a_second() -> None:
    with pytest.raises(ValidationError):
        BusSettings(lease_s=0.05)


def test_zenoh_searches_for_no_station_and_lets_none_search() -> None:
    config = configuration("north", ENDPOINTS, None)
    assert json.loads(config.get_json("listen/endpoints")) == ["tcp/127.0.0.1:7400"]
    assert json.loads(config.get_json("connect/endpoints")) == ["tcp/127.0.0.1:7401"]
    for way in ("multicast", "gossip"):
        assert json.loads(config.get_json(f"scouting/{way}/enabled")) is False
    assert json.loads(config.get_json("transport/link/tx/lease")) == 1000


def test_of_each_pair_of_stations_one_connects() -> None:
    """When both did, messages of a station that had stopped for long sometimes never arrived again."""
    endpoints = {name: Endpoint(host="127.0.0.1", port=7400 + k) for k, name in enumerate("dbca")}
    listens, connects = [], []
    for name in endpoints:
        config = configuration(name, endpoints, None)
        (own,) = json.loads(config.get_json("listen/endpoints"))
        listens.append(own)
        connects += [{own, other} for other in json.loads(config.get_json("connect/endpoints"))]
    pairs = [{one, other} for one, other in combinations(listens, 2)]
    assert len(connects) == len(pairs)
    assert all(pair in connects for pair in pairs)


def test_with_keys_only_tls_is_spoken_and_all_else_is_denied(tmp_path: Path) -> None:
    make_site_keys(tmp_path, {name: ["127.0.0.1"] for name in ENDPOINTS})
    config = configuration("north", ENDPOINTS, tmp_path)
    assert json.loads(config.get_json("transport/link/protocols")) == ["tls"]
    assert json.loads(config.get_json("transport/link/tls/enable_mtls")) is True
    access = json.loads(config.get_json("access_control"))
    assert (access["enabled"], access["default_permission"]) == (True, "deny")


def test_missing_keys_are_named(tmp_path: Path) -> None:
    make_site_keys(tmp_path, {"north": ["127.0.0.1"]})
    with pytest.raises(LinkError, match=r"south\.pem is missing: gcs key site makes it"):
        configuration("south", ENDPOINTS, tmp_path)
