"""The placement of a drawn show over REST: its pads beside the vehicles, fitted, moved, checked again."""

from pathlib import Path
from shutil import copytree

import httpx
import pytest

from gcs.config.yaml_files import shipped_folder
from gcs.model.lifecycle import Phase
from tests.support.api_fake_service import FRAME, FakeService
from tests.support.api_harness import Api

SHIPPED = (shipped_folder() / "shows" / "drawn-30.skyc").read_bytes()
PLACEMENT = "/api/v1/shows/night/placement"


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of shows after the import, which is a process of its own."""
    folder = tmp_path_factory.mktemp("imported")
    api = Api(FakeService(30, folder=folder))
    answer = api("POST", "/api/v1/shows?name=night&format=skyc&origin=service", content=SHIPPED)
    assert answer.status_code == 201, answer.text
    return folder


@pytest.fixture
def service(imported: Path, tmp_path: Path) -> FakeService:
    """Thirty vehicles on the ground, 5 m apart along y."""
    return FakeService(30, folder=copytree(imported, tmp_path / "shows"))


@pytest.fixture
def api(service: FakeService) -> Api:
    return Api(service)


def detail(answer: httpx.Response, status: int) -> str:
    assert answer.status_code == status, answer.text
    return str(answer.json()["detail"])


def test_pads_are_shown_beside_the_vehicles(api: Api, service: FakeService) -> None:
    service.phases["d2"] = Phase.OFFLINE
    service.tick()
    found = api("GET", PLACEMENT).json()
    assert (found["show"], found["assigned"], found["origin_changes"]) == ("night", "nearest", False)
    assert found["stored"] == {"x_m": 0.0, "y_m": 0.0, "turn_deg": 0.0}
    assert found["heading_deg"] == FRAME.heading_deg
    assert len(found["pads_m"]) == 30
    assert [one["id"] for one in found["vehicles"]] == [f"d{row}" for row in range(1, 31)]
    assert found["vehicles"][1] == {"id": "d2", "x_m": None, "y_m": None, "pad": None, "off_m": None}
    at = found["vehicles"][0]
    pad_m = found["pads_m"][at["pad"]]
    away_m = ((at["x_m"] - pad_m[0]) ** 2 + (at["y_m"] - pad_m[1]) ** 2) ** 0.5
    assert at["off_m"] == pytest.approx(away_m, abs=0.02)
    assert found["max_m"] == max(one["off_m"] for one in found["vehicles"] if one["off_m"] is not None)


@pytest.mark.soak
def test_the_fit_is_better_and_changes_nothing(api: Api, service: FakeService) -> None:
    text = api("GET", "/api/v1/shows/night").json()["text"]
    here = api("GET", f"{PLACEMENT}?x_m=40&y_m=0&turn_deg=10").json()
    assert (here["x_m"], here["y_m"], here["turn_deg"]) == (40.0, 0.0, 10.0)
    best = api("GET", f"{PLACEMENT}?x_m=40&y_m=0&turn_deg=10&fit=true").json()
    assert best["rms_m"] < here["rms_m"]
    assert api("GET", "/api/v1/shows/night").json()["text"] == text
    service.phases |= dict.fromkeys(service.phases, Phase.OFFLINE)
    service.tick()
    assert "nothing to fit to" in detail(api("GET", f"{PLACEMENT}?fit=true"), 409)


@pytest.mark.soak
def test_a_placed_show_is_another_version(api: Api, service: FakeService) -> None:
    before = api("GET", "/api/v1/shows").json()[0]
    body = {"x_m": 12.5, "y_m": -3.0, "turn_deg": 30.0}
    answer = api("PUT", PLACEMENT, json=body)
    assert answer.status_code == 200, answer.text
    assert answer.json()["stored"] == body
    after = api("GET", "/api/v1/shows").json()[0]
    assert (after["drawing"], after["hash"]) == (before["drawing"], None)
    assert "place: {x_m: 12.5, y_m: -3, turn_deg: 30}" in api("GET", "/api/v1/shows/night").json()["text"]
    assert api("GET", PLACEMENT).json()["stored"] == body
    first = api("GET", "/api/v1/shows/night/drawing?from_s=0&to_s=0").json()["positions_m"][0][:2]
    api("PUT", PLACEMENT, json={"x_m": 0.0, "y_m": 0.0, "turn_deg": 0.0})
    unplaced = api("GET", "/api/v1/shows/night/drawing?from_s=0&to_s=0").json()["positions_m"][0][:2]
    assert first != pytest.approx(unplaced, abs=1.0)


@pytest.mark.soak
def test_a_show_drawn_elsewhere_keeps_its_place_on_earth(tmp_path: Path) -> None:
    api = Api(FakeService(3, folder=tmp_path / "shows"))
    assert api("POST", "/api/v1/shows?name=night&format=skyc", content=SHIPPED).status_code == 201
    found = api("GET", PLACEMENT).json()
    assert found["origin_changes"]
    stored = found["stored"]
    assert stored["turn_deg"] != 0.0
    body = {key: stored[key] for key in ("x_m", "y_m", "turn_deg")}
    placed = api("PUT", PLACEMENT, json=body).json()
    assert not placed["origin_changes"]
    text = api("GET", "/api/v1/shows/night").json()["text"]
    assert f"heading_deg: {FRAME.heading_deg:g}" in text
    again = api("GET", PLACEMENT).json()
    assert again["pads_m"] == found["pads_m"]


@pytest.mark.parametrize(
    "body",
    [
        {"x_m": 1.0, "y_m": 2.0},
        {"x_m": 1.0, "y_m": 2.0, "turn_deg": 400.0},
        {"x_m": 1e6, "y_m": 2.0, "turn_deg": 0.0},
        {"x_m": "1", "y_m": 2.0, "turn_deg": 0.0},
        {"x_m": 1.0, "y_m": 2.0, "turn_deg": 0.0, "z_m": 1.0},
    ],
)
def test_a_wrong_placement_is_refused(api: Api, body: dict[str, object]) -> None:
    assert detail(api("PUT", PLACEMENT, json=body), 422)


def test_only_drawn_shows_are_placed(api: Api) -> None:
    api("PUT", "/api/v1/shows/plain", content=b"about: x")
    body = {"x_m": 0.0, "y_m": 0.0, "turn_deg": 0.0}
    assert "has no drawing" in detail(api("PUT", "/api/v1/shows/plain/placement", json=body), 409)
    assert "no show 'other'" in detail(api("GET", "/api/v1/shows/other/placement"), 404)
