"""Show files and their checks over REST: what is kept, what is refused, and what that changes."""

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from gcs.api.context import Feed
from gcs.service import Features
from gcs.shows import load, shipped
from gcs.shows.library import FILES_MAX, SIZE_MAX_BYTES
from tests.support.api_fake_service import FakeService
from tests.support.api_harness import Api
from tests.support.show_files import FIGURES
from tests.support.timecode import VIEW

LIGHTHOUSE = next(path for path in shipped() if path.stem == "lighthouse").read_text()
SHOW = load(next(path for path in shipped() if path.stem == "lighthouse")).show
PATH = "/api/v1/shows/lighthouse"


@pytest.fixture
def api(tmp_path: Path) -> Api:
    return Api(FakeService(folder=tmp_path / "shows"))


def kept(api: Api) -> dict[str, str]:
    names = [each["name"] for each in api("GET", "/api/v1/shows").json()]
    return {name: api("GET", f"/api/v1/shows/{name}").json()["text"] for name in names}


def pass_check(api: Api, text: str = LIGHTHOUSE, *, good: bool = True) -> str:
    """As a check that found nothing wrong, or something. Returns: the hash."""
    answer: dict[str, Any] = {
        **FIGURES,
        "good": good,
        "problems": [] if good else [{"line": 3, "cue": "lamp", "text": "too fast"}],
        "model": SHOW.model_dump(mode="json"),
    }
    reported = api.service.shows.found("lighthouse", text.encode(), answer)
    assert reported.hash == SHOW.digest
    return SHOW.digest


def detail(answer: httpx.Response, status: int) -> str:
    assert answer.status_code == status, answer.text
    return str(answer.json()["detail"])


def test_uploaded_show_is_listed_and_read_back_unchanged(api: Api) -> None:
    assert api("GET", "/api/v1/shows").json() == []
    answer = api("PUT", PATH, content=LIGHTHOUSE.encode())
    assert answer.status_code == 200
    assert answer.json()["size_bytes"] == len(LIGHTHOUSE.encode())
    assert answer.json()["replaced"] is False
    assert kept(api) == {"lighthouse": LIGHTHOUSE}
    assert api("PUT", PATH, content=b"about: another").json()["replaced"] is True
    assert kept(api) == {"lighthouse": "about: another"}


def test_the_list_has_the_hash_that_a_start_names(api: Api) -> None:
    """Of the file as it is: not before its check, nor after another upload."""
    hashes = []
    for text in (LIGHTHOUSE, f"{LIGHTHOUSE}# again\n"):
        api("PUT", PATH, content=text.encode())
        hashes.append(api("GET", "/api/v1/shows").json()[0]["hash"])
        show_hash = pass_check(api, text)
        hashes.append(api("GET", "/api/v1/shows").json()[0]["hash"])
    assert hashes == [None, show_hash, None, show_hash]


def test_a_show_that_is_removed_is_gone(api: Api) -> None:
    api("PUT", PATH, content=LIGHTHOUSE.encode())
    assert api("DELETE", PATH).status_code == 204
    assert kept(api) == {}
    assert "no show" in detail(api("DELETE", PATH), 404)
    assert "no show" in detail(api("GET", PATH), 404)


@pytest.mark.parametrize(
    ("content", "status", "says"),
    [
        (b"", 422, "at most"),
        (b" \n", 422, "at most"),
        (b"\xff\xfe", 422, "UTF-8"),
        (b"x" * (SIZE_MAX_BYTES + 1), 413, "larger than"),
    ],
)
def test_invalid_or_oversized_upload_keeps_the_existing_show(
    api: Api, content: bytes, status: int, says: str
) -> None:
    api("PUT", PATH, content=LIGHTHOUSE.encode())
    assert says in detail(api("PUT", PATH, content=content), status)
    assert kept(api) == {"lighthouse": LIGHTHOUSE}


@pytest.mark.parametrize("name", ["..%2Fetc", ".hidden", "a.b", "-x", "a" * 61, "a%00b", "%C3%A4"])
def test_names_that_could_lead_elsewhere_are_refused(api: Api, tmp_path: Path, name: str) -> None:
    answer = api("PUT", f"/api/v1/shows/{name}", content=LIGHTHOUSE.encode())
    assert answer.status_code in {404, 422}
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_full_or_unwritable_folder_is_reported(api: Api, tmp_path: Path) -> None:
    folder = tmp_path / "shows"
    folder.mkdir()
    for number in range(FILES_MAX):
        (folder / f"s{number}.yaml").write_text("about: x")
    assert f"{FILES_MAX} shows already" in detail(api("PUT", PATH, content=b"about: x"), 409)
    assert api("PUT", "/api/v1/shows/s1", content=b"about: y").status_code == 200
    blocked = Api(FakeService(folder=folder / "s1.yaml" / "inside"))
    assert "cannot be kept" in detail(blocked("PUT", PATH, content=b"about: x"), 409)


def test_service_without_a_folder_names_what_is_missing() -> None:
    api = Api()
    assert api("GET", "/api/v1/shows").json() == []
    for method, path in (("PUT", PATH), ("GET", PATH), ("POST", f"{PATH}/check")):
        content = LIGHTHOUSE.encode() if method == "PUT" else None
        assert "shows.folder" in detail(api(method, path, content=content), 409)


def test_only_the_show_that_was_checked_can_be_selected(api: Api) -> None:
    def select(show_hash: str) -> httpx.Response:
        return api("POST", f"{PATH}/select", json={"hash": show_hash})

    assert "no show" in detail(select(SHOW.digest), 404)
    api("PUT", PATH, content=LIGHTHOUSE.encode())
    assert "has not been checked" in detail(select(SHOW.digest), 409)
    pass_check(api, good=False)
    assert "not good to fly: line 3: cue 'lamp': too fast" in detail(select(SHOW.digest), 409)
    pass_check(api)
    assert "was checked with the hash" in detail(select("0" * 64), 409)
    assert detail(select("lighthouse"), 422)
    assert select(SHOW.digest).json()["cue"] == "lamp"
    api("PUT", PATH, content=LIGHTHOUSE.replace("radius_m: 10", "radius_m: 11").encode())
    assert "has changed since it was checked" in detail(select(SHOW.digest), 409)


def test_selected_show_is_shown_sought_started_and_deselected(api: Api) -> None:
    api("PUT", PATH, content=LIGHTHOUSE.encode())
    show_hash = pass_check(api)
    assert "no show is selected" in detail(api("POST", "/api/v1/show/seek", json={"cue": "lamp"}), 409)
    api("POST", f"{PATH}/select", json={"hash": show_hash})
    assert "no cue nowhere" in detail(api("POST", "/api/v1/show/seek", json={"cue": "nowhere"}), 404)
    assert api("POST", "/api/v1/show/seek", json={"cue": "up the tower"}).json()["cue"] == "up the tower"
    api.service.tick()
    seen = api("GET", "/api/v1/show").json()["selected"]
    assert (seen["name"], seen["hash"], seen["cue"], seen["runs"]) == (
        "lighthouse",
        show_hash,
        "up the tower",
        False,
    )
    assert detail(api("POST", "/api/v1/show/start"), 409)
    assert detail(api("POST", "/api/v1/show/start", json={"show_hash": "0" * 64}), 409)
    past = {"show_hash": show_hash, "at_unix_time_s": 1000.0}
    assert "ahead" in detail(api("POST", "/api/v1/show/start", json=past), 422)
    ahead = {"show_hash": show_hash, "at_unix_time_s": 9e9}
    assert api("POST", "/api/v1/show/start", json=ahead).status_code == 202
    api.service.tick()
    show = api("GET", "/api/v1/show").json()
    assert (show["phase"], show["start_unix_time_s"]) == ("countdown", 9e9)
    assert show["countdown_s"] > 1e9
    assert set(show["possible"]) == {"start", "stop", "abort"}
    api.service.reset()
    assert api("POST", "/api/v1/show/deselect").status_code == 204
    assert api("GET", "/api/v1/show").json()["selected"] is None


def test_a_time_to_begin_is_set_shown_and_cancelled(api: Api) -> None:
    api("PUT", PATH, content=LIGHTHOUSE.encode())
    show_hash = pass_check(api)
    begin = "/api/v1/show/begin"
    assert "no show is selected" in detail(api("POST", begin, json={"at_unix_time_s": 9e9}), 409)
    api("POST", f"{PATH}/select", json={"hash": show_hash})
    assert "no time to begin" in detail(api("DELETE", begin), 409)
    far = {"at_unix_time_s": 9e9}
    for wrong in (
        {},
        {"at_unix_time_s": "soon"},
        {**far, "more": 1},
        {"at_unix_time_s": 9.0},
    ):
        assert detail(api("POST", begin, json=wrong), 422)
    answer = api("POST", begin, json={"at_unix_time_s": 9e9}).json()
    assert (answer["begin"]["state"], answer["begin"]["at_unix_time_s"]) == ("armed", 9e9)
    api.service.tick()
    assert api("GET", "/api/v1/show").json()["selected"]["begin"]["in_s"] > 1e9
    assert api("DELETE", begin).json()["begin"] is None


def test_timecode_is_shown_and_let_go(api: Api) -> None:
    follow = "/api/v1/show/external-clock"
    assert "no timecode is configured" in detail(api("POST", follow, json={"follow": False}), 409)
    assert api("GET", "/api/v1/fleet").json()["features"]["timecode"] is None
    api.service.features = Features(timecode=VIEW)
    api.service.tick()
    shown = api("GET", "/api/v1/fleet").json()["features"]["timecode"]
    assert (shown["label"], shown["behind_s"], shown["age_s"]) == ("01:00:02:12", 0.012, None)
    assert api("POST", follow, json={"follow": False}).status_code == 204
    api.service.tick()
    assert not api("GET", "/api/v1/fleet").json()["features"]["timecode"]["followed"]
    text = api("GET", "/metrics").text
    assert 'gcs_timecode_state{state="running"} 1.0' in text
    assert "gcs_timecode_behind_seconds 0.012" in text
    assert "gcs_show_tempo 1.001" in text
    assert "gcs_timecode_age_seconds NaN" in text


def test_a_running_timecode_causes_no_new_status(api: Api) -> None:
    """Nor does a show that waits for its time: frames have what moves. That it freezes is in the status."""
    api("PUT", PATH, content=LIGHTHOUSE.encode())
    api("POST", f"{PATH}/select", json={"hash": pass_check(api)})
    api("POST", "/api/v1/show/begin", json={"at_unix_time_s": 9e9})
    feed, service = Feed(api.service, "off", str), api.service
    service.features = Features(timecode=VIEW)
    service.tick()
    first, text = feed.status(0.0)
    assert '"label":"01:00:02:12"' in text
    assert '"at_unix_time_s":9000000000.0' in text
    moved = replace(
        VIEW, label="01:00:09:00", age_s=0.02, behind_s=-0.01, slope=0.999, tempo=1.0, readings=99
    )
    service.features = Features(timecode=moved)
    service.tick()
    assert feed.status(1.0)[0] == first
    lost = replace(moved, state="lost", problem="gone", frozen_since_unix_time_s=1.8e9)
    service.features = Features(timecode=lost)
    service.tick()
    revision, text = feed.status(2.0)
    assert revision == first + 1
    assert '"frozen_since_unix_time_s":1800000000.0' in text


def test_unknown_check_is_404_and_missing_file_fails_its_check(api: Api) -> None:
    assert "has not been checked" in detail(api("GET", f"{PATH}/check"), 404)
    shows = api.service.shows

    async def checked() -> None:
        assert shows.check("lighthouse").state == "waiting"
        async with asyncio.timeout(240):
            while shows.checked("lighthouse").state in {"waiting", "running"}:  # noqa: ASYNC110
                await asyncio.sleep(0.01)

    asyncio.run(checked())
    answer = api("GET", f"{PATH}/check").json()
    assert (answer["state"], answer["good"]) == ("failed", False)
    assert "no show 'lighthouse'" in answer["reason"]


def test_at_most_two_checks_run(api: Api) -> None:
    async def three() -> None:
        shows = api.service.shows
        shows.check("one")
        with pytest.raises(Exception, match="being checked already"):
            shows.check("one")
        shows.check("two")
        with pytest.raises(Exception, match="wait for one, two"):
            shows.check("three")
        await shows.close()
        assert shows.checked("two").state == "failed"

    asyncio.run(three())


@pytest.mark.usefixtures("prompt_checks")
@pytest.mark.parametrize("levels", [pytest.param(5, marks=pytest.mark.soak), 9])
def test_yaml_bomb_is_a_short_problem_with_line_and_column(api: Api, levels: int) -> None:
    """Before: 351 MB of text with 8 levels, parsed on the loop."""
    lines = ["about: &a0 [" + "lol, " * 9 + "]"]
    lines += [f"k{level}: &a{level} [" + f"*a{level - 1}, " * 9 + "]" for level in range(1, levels)]
    assert api("PUT", PATH, content="\n".join(lines).encode()).status_code == 200

    async def checked() -> None:
        api.service.shows.check("lighthouse")
        async with asyncio.timeout(240):
            while api.service.shows.checked("lighthouse").state in {"waiting", "running"}:  # noqa: ASYNC110
                await asyncio.sleep(0.05)

    asyncio.run(checked())
    answer = api("GET", f"{PATH}/check")
    reported = answer.json()
    assert (reported["state"], reported["good"]) == ("done", False)
    (problem,) = reported["problems"]
    assert problem["line"] == 1
    assert problem["text"].startswith("column 8: &a0: anchors are not allowed")
    assert len(answer.content) < 1000
    assert api("POST", f"{PATH}/select", json={"hash": SHOW.digest}).status_code == 409


def test_status_explains_why_no_show_can_be_uploaded(api: Api) -> None:
    assert api("GET", "/api/v1/status").json()["shows_refused"] == ""
    nowhere = Api(FakeService())
    reason = nowhere("GET", "/api/v1/status").json()["shows_refused"]
    assert "shows.folder" in reason
    refused = nowhere("PUT", PATH, content=LIGHTHOUSE.encode())
    assert (refused.status_code, refused.json()["detail"]) == (409, reason)
