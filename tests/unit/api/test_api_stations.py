"""Several stations that fly one formation, at the API of one of them."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import TypeAdapter

from gcs.api.context import Feed
from gcs.api.schemas import binary_frame as frames
from gcs.api.schemas import convert
from gcs.estimation.time_estimates import nothing
from gcs.model.lifecycle import Phase
from gcs.service import BusView, StationView
from tests.support.api_fake_service import FRAME, FakeService
from tests.support.api_harness import Api

NAMES = ("north", "south", "west", "east")


@pytest.fixture
def site() -> FakeService:
    return FakeService(8, station_names=NAMES)


def test_stations_are_listed_with_their_vehicles(site: FakeService) -> None:
    site.silent_s["west"] = 2.5
    site.tick()
    api = Api(site)
    listed = api("GET", "/api/v1/stations").json()
    assert [each["name"] for each in listed] == list(NAMES)
    assert [each["received"] for each in listed] == [True, True, False, True]
    assert listed[2]["silent_s"] == 2.5
    assert [each["own"] for each in listed] == [each["leads"] for each in listed] == [True, *[False] * 3]
    assert {each["vehicles"] for each in listed} == {2}
    fleet = api("GET", "/api/v1/fleet").json()
    status = api("GET", "/api/v1/status").json()
    assert fleet["stations"] == status["stations"] == listed
    owners = [name for name in NAMES for _ in range(2)]
    for document in (fleet, status):
        assert [each["station"] for each in document["vehicles"]] == owners
    assert api("GET", "/api/v1/vehicles/d8").json()["station"] == "east"


def test_one_station_lists_no_stations_and_has_no_lead() -> None:
    api = Api()
    assert api("GET", "/api/v1/stations").json() == []
    fleet = api("GET", "/api/v1/fleet").json()
    assert fleet["stations"] == []
    assert {each["station"] for each in fleet["vehicles"]} == {None}
    refused = api("POST", "/api/v1/stations/lead")
    assert refused.status_code == 409
    assert "no other station" in refused.json()["detail"]


def test_lead_is_taken_by_the_station_that_is_asked(site: FakeService) -> None:
    site.lead = "south"
    site.tick()
    api = Api(site)
    answer = api("POST", "/api/v1/stations/lead")
    assert answer.status_code == 200
    assert [each["name"] for each in answer.json() if each["leads"]] == ["north"]
    assert {each["term"] for each in answer.json()} == {2}
    site.tick()
    assert api("GET", "/api/v1/stations").json() == answer.json()


def test_vehicles_of_other_stations_have_no_estimates_here(site: FakeService) -> None:
    found = replace(nothing(2), low_s=np.array([120.0, 90.0]), empty_s=np.array([240.0, 180.0]), low_row=1)
    view = replace(site.view.value, estimates=found)
    fleet = convert.fleet(view, FRAME, "", "off")
    assert [each.low_s for each in fleet.vehicles] == [120.0, 90.0, *[None] * 6]
    assert fleet.estimates is not None
    assert fleet.estimates.low_vehicle == "d2"
    data = frames.encode(view, FRAME, revision=1, alive=True)
    low_s = np.frombuffer(data, "<f4", len(frames.FLOATS) * 8, 128).reshape(-1, 8)[
        frames.FLOATS.index("low_s")
    ]
    np.testing.assert_array_equal(low_s, [120.0, 90.0, *[np.nan] * 6])


def test_vehicle_of_no_known_station_has_none(site: FakeService) -> None:
    view = site.view.value
    rows = replace(view.rows, stations=[*view.rows.stations[:7], ""])
    assert convert.records(rows)[7].station is None


def test_status_is_sent_again_for_a_lost_station_not_for_a_delay(site: FakeService) -> None:
    feed = Feed(site, "off", str)
    first, _ = feed.status(0.0)
    site.tick()
    view = site.view.value
    later = tuple(replace(each, delay_s=0.3, silent_s=0.2) for each in view.stations)
    site.view.promise(lambda: replace(view, stations=later))
    assert feed.status(1.0)[0] == first
    site.silent_s["east"] = 1.0
    site.tick()
    revision, text = feed.status(2.0)
    assert revision == first + 1
    assert '"received":false' in text


def test_commands_name_vehicles_of_any_station(site: FakeService) -> None:
    site.fly()
    api = Api(site)
    assert api("POST", "/api/v1/vehicles/d8/hold").status_code == 202
    answer = api("POST", "/api/v1/fleet/land", json={"vehicles": ["d1", "d5"]})
    assert set(answer.json()["outcomes"]) == {"d1", "d5"}
    armed = api("POST", "/api/v1/kill", json={"vehicles": ["d7"]}).json()
    assert armed["vehicles"] == ["d7"]
    assert api("POST", "/api/v1/kill/confirm", json={"code": armed["code"]}).status_code == 202
    assert site.phases["d7"] is Phase.KILLED


def test_each_station_checks_its_own_vehicles_and_excludes_all(site: FakeService) -> None:
    api = Api(site)
    report = api("GET", "/api/v1/preflight").json()
    assert report["not_checked"][1:] == [
        f"vehicles of station {name}: 2, which it checks" for name in NAMES[1:]
    ]
    mixed = api("GET", "/api/v1/preflight?vehicles=d1&vehicles=d3").json()
    assert mixed["not_checked"][1:] == ["vehicles of station south: 1, which it checks"]
    refused = api("GET", "/api/v1/preflight?vehicles=d3")
    assert refused.status_code == 409
    assert "d3 (south)" in refused.json()["detail"]
    assert api("GET", "/api/v1/preflight?vehicles=x1").status_code == 404
    for action in ("exclude", "include"):
        assert api("POST", f"/api/v1/vehicles/d3/{action}").json()["outcomes"].keys() == {"d3"}
    assert api("POST", "/api/v1/vehicles/d2/exclude").status_code == 202


def test_metrics_tell_stations_apart(site: FakeService) -> None:
    site.silent_s["west"] = 2.5
    site.tick()
    lines = Api(site)("GET", "/metrics").text.splitlines()
    assert 'gcs_station_received{station="west"} 0.0' in lines
    assert 'gcs_station_received{station="east"} 1.0' in lines
    assert 'gcs_station_silent_seconds{station="west"} 2.5' in lines
    assert 'gcs_station_vehicles{station="south"} 2.0' in lines
    assert 'gcs_station_delay_seconds{station="south"} 0.002' in lines
    assert 'gcs_station_leads{station="north"} 1.0' in lines
    others = ("gcs_station", "gcs_bus")
    assert not [line for line in Api()("GET", "/metrics").text.splitlines() if line.startswith(others)]


def test_metrics_count_messages_on_the_bus(site: FakeService) -> None:
    view = site.view.value
    site.view.promise(lambda: replace(view, bus=BusView(20, 4000, 60, 3)))
    lines = Api(site)("GET", "/metrics").text.splitlines()
    assert [line for line in lines if line.startswith("gcs_bus")] == [
        "gcs_bus_messages_sent_total 20.0",
        "gcs_bus_sent_bytes_total 4000.0",
        "gcs_bus_messages_received_total 60.0",
        "gcs_bus_messages_refused_total 3.0",
    ]


def test_vehicles_of_a_lost_station_are_flown_on(site: FakeService) -> None:
    api = Api(site)
    refused = api("POST", "/api/v1/stations/south/take-over")
    assert refused.status_code == 409
    assert "is not lost" in refused.json()["detail"]
    site.silent_s["south"] = 2.5
    accepted = api("POST", "/api/v1/stations/south/take-over")
    assert accepted.status_code == 202
    assert accepted.headers["Location"] == f"/api/v1/commands/{accepted.json()['id']}"
    assert Api()("POST", "/api/v1/stations/south/take-over").status_code == 409


def test_example_of_the_document_is_an_answer_of_stations() -> None:
    paths = Api().app.openapi()["paths"]
    for path, method in (("/api/v1/stations", "get"), ("/api/v1/stations/lead", "post")):
        example = paths[path][method]["responses"]["200"]["content"]["application/json"]["example"]
        found = TypeAdapter(list[StationView]).validate_python(example)
        assert sum(each.own for each in found) == sum(each.leads for each in found) == 1
