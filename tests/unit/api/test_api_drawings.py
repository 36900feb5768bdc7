"""Drawings over REST: upload as a show, refusals with the place in the file, samples for a preview."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import httpx
import pytest

from gcs.api import drawings
from gcs.config.yaml_files import shipped_folder
from gcs.model.lifecycle import ShowPhase
from gcs.recording.session import Record
from gcs.service import check_process
from tests.support.api_fake_service import FRAME, FakeService
from tests.support.api_harness import Api
from tests.support.audit_rows import calls
from tests.support.drawing_files import HOVER, skyc, zipped

SHIPPED = (shipped_folder() / "shows" / "drawn-30.skyc").read_bytes()
IMPORT = "/api/v1/shows?name=night&format=skyc"


@pytest.fixture
def api(tmp_path: Path) -> Api:
    return Api(FakeService(folder=tmp_path / "shows"))


def detail(answer: httpx.Response, status: int) -> str:
    assert answer.status_code == status, answer.text
    return str(answer.json()["detail"])


def kept(tmp_path: Path) -> list[str]:
    folder = tmp_path / "shows"
    return sorted(path.name for path in folder.iterdir()) if folder.exists() else []


def test_an_uploaded_drawing_becomes_a_show(api: Api, tmp_path: Path) -> None:
    answer = api("POST", IMPORT, content=SHIPPED)
    assert answer.status_code == 201, answer.text
    found = answer.json()
    assert (found["show"], found["drawing"]) == ("night", "night.skyc")
    assert (found["vehicles"], found["duration_s"], found["notes"]) == (30, 70.0, [])
    assert found["replaced"] is False
    assert set(found["claims"]) >= {"separation_min_m", "speed_max_m_s"}
    (listed,) = api("GET", "/api/v1/shows").json()
    assert (listed["name"], listed["drawing"]) == ("night", "night.skyc")
    assert (tmp_path / "shows" / "night.skyc").read_bytes() == SHIPPED
    assert api("DELETE", "/api/v1/shows/night").status_code == 204
    assert kept(tmp_path) == []


def test_a_drawing_without_a_place_gets_the_services(api: Api) -> None:
    plain = zipped(skyc(HOVER))
    assert api("POST", IMPORT, content=plain).status_code == 201
    text = api("GET", "/api/v1/shows/night").json()["text"]
    assert f"latitude_deg: {FRAME.latitude_deg}" in text
    assert f"heading_deg: {FRAME.heading_deg:g}" in text


def test_a_broken_drawing_is_refused_with_its_place(api: Api, tmp_path: Path) -> None:
    answer = api("POST", IMPORT, content=zipped({"show.json": "{"}))
    assert "night.skyc: show.json: not JSON" in detail(answer, 422)
    assert str(tmp_path) not in answer.text
    assert "gcs-import" not in answer.text
    assert "file of a drawing" in detail(api("POST", IMPORT, content=b""), 422)
    assert kept(tmp_path) == []


@pytest.mark.parametrize(
    "query",
    [
        "name=night",
        "format=skyc",
        "name=..%2Fa&format=skyc",
        "name=a&format=exe",
        "name=a&format=csv&origin=x",
    ],
)
def test_a_wrong_query_is_refused_before_the_body(api: Api, query: str) -> None:
    assert detail(api("POST", f"/api/v1/shows?{query}", content=SHIPPED), 422)


def test_too_large_or_slow_a_drawing_is_refused(
    api: Api, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drawings, "UPLOAD_S", 0.0)
    assert "did not come within" in detail(api("POST", IMPORT, content=SHIPPED), 408)
    monkeypatch.undo()
    monkeypatch.setattr(drawings, "DRAWING_MAX_BYTES", len(SHIPPED) - 1)
    assert "larger than" in detail(api("POST", IMPORT, content=SHIPPED), 413)
    compressed = {"Content-Encoding": "gzip"}
    assert "gzip is not accepted" in detail(api("POST", IMPORT, content=SHIPPED, headers=compressed), 415)
    assert kept(tmp_path) == []


def test_a_service_without_a_folder_takes_no_drawing() -> None:
    assert "shows.folder" in detail(Api()("POST", IMPORT, content=SHIPPED), 409)


def test_only_some_drawings_are_read_at_once(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawings, "WAITING_MAX", 0)
    assert "are being read" in detail(api("POST", IMPORT, content=SHIPPED), 409)


@pytest.mark.alternates(0)
@pytest.mark.parametrize(
    ("phase", "lowered"), [(ShowPhase.IDLE, False), (ShowPhase.RUNNING, True), (ShowPhase.UNCONTROLLED, True)]
)
def test_a_drawing_is_read_at_low_priority_beside_a_flight_only(
    api: Api, monkeypatch: pytest.MonkeyPatch, phase: ShowPhase, lowered: bool
) -> None:
    """At a low priority an upload takes many times as long on a busy machine."""
    given: list[int] = []

    async def noted(arguments: Sequence[str], within_s: float, priority: int, **more: Any) -> bytes:
        given.append(priority)
        return await check_process.printed(arguments, within_s, priority, **more)

    monkeypatch.setattr(drawings, "printed", noted)
    api.service.show = phase
    api.service.tick()
    assert api("POST", IMPORT, content=SHIPPED).status_code == 201
    assert [priority > 0 for priority in given] == [lowered]


def test_the_record_has_an_uploads_query_not_its_body(tmp_path: Path) -> None:
    with Record(tmp_path, "{}", {"d1": (1, "radio")}, flight=False) as record:
        service = FakeService()
        service.audit = record.audit
        assert Api(service)("POST", IMPORT, content=SHIPPED).status_code == 409
    (call,) = calls(tmp_path)
    assert (call["path"], call["body"]) == ("/api/v1/shows", "name=night&format=skyc")


@pytest.mark.soak
def test_a_drawn_show_is_sampled_for_a_preview(api: Api) -> None:
    assert "no show 'night'" in detail(api("GET", "/api/v1/shows/night/drawing"), 404)
    assert api("POST", IMPORT, content=SHIPPED).status_code == 201
    path = "/api/v1/shows/night/drawing?from_s=10&to_s=20&rate_hz=2"
    answer = api("GET", path)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert (found["show"], found["from_s"], found["rate_hz"]) == ("night", 10.0, 2.0)
    assert len(found["vehicles"]) == 30
    assert {len(row) for row in found["positions_m"]} == {3 * 30}
    assert {len(row) for row in found["colours"]} == {6 * 30}
    assert len(found["positions_m"]) == len(found["colours"]) == 21
    assert min(found["positions_m"][0][2::3]) >= 3.0
    assert found["cues"][0]["at_s"] == 0.0
    assert "no drawing" not in answer.text
    assert detail(api("GET", "/api/v1/shows/night/drawing?rate_hz=1000"), 422)
    assert "are needed" in detail(api("GET", "/api/v1/shows/night/drawing?from_s=1000"), 409)
    api("PUT", "/api/v1/shows/plain", content=b"about: x")
    assert "has no drawing" in detail(api("GET", "/api/v1/shows/plain/drawing"), 409)
