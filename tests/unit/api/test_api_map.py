"""The map that the page draws: told by the status, served from a file, or asked of one other origin."""

import asyncio
from pathlib import Path

import httpx
import pytest

from gcs.api.app import create_app
from gcs.api.auth.authorization import Authorization
from gcs.api.auth.tokens import Tokens, create_token
from gcs.api.map_tiles import GroundMap, open_map
from gcs.service.access import Role
from gcs.service.map_settings import MapSettings
from tests.support.api_fake_service import FakeService
from tests.support.mbtiles import mbtiles

ADDRESS = "https://maps.example:8443/tiles/{z}/{x}/{y}.png?key=a"
PICTURE = b"\x89PNG and so on"


def ask(
    ground: GroundMap | None, path: str, authorization: Authorization | None = None, token: str = ""
) -> httpx.Response:
    app = create_app(FakeService(), authorization=authorization, ground=ground)
    headers = {"Authorization": f"Bearer {token}"} if token else {}

    async def once() -> httpx.Response:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return await client.get(path, headers=headers)

    return asyncio.run(once())


@pytest.fixture
def field(tmp_path: Path) -> GroundMap | None:
    path = mbtiles(tmp_path / "field.mbtiles", {"format": "png"}, {(3, 1, 6): PICTURE})
    return open_map(MapSettings(tiles=str(path), attribution="© Crew"))


def test_map_tile_is_an_image_and_status_gives_its_place(field: GroundMap | None) -> None:
    reported = ask(field, "/api/v1/status").json()["map"]
    assert reported["tiles"].startswith("/api/v1/map/{z}/{x}/{y}?v=")
    assert reported == {
        "tiles": reported["tiles"],
        "attribution": "© Crew",
        "zoom_min": 3,
        "zoom_max": 3,
    }
    answer = ask(field, reported["tiles"].format(z=3, x=1, y=1))
    assert (answer.status_code, answer.content) == (200, PICTURE)
    assert answer.headers["content-type"] == "image/png"
    assert answer.headers["x-content-type-options"] == "nosniff"


def test_without_a_map_the_status_says_so(field: GroundMap | None) -> None:
    assert ask(None, "/api/v1/status").json()["map"] is None
    for ground in (None, open_map(MapSettings(tiles=ADDRESS))):
        answer = ask(ground, "/api/v1/map/3/1/1")
        assert (answer.status_code, "map.tiles" in answer.json()["detail"]) == (404, True)
    answer = ask(field, "/api/v1/map/3/1/2")
    assert (answer.status_code, answer.json()["detail"]) == (404, "field.mbtiles has no tile 3/1/2")


def test_failing_disk_is_not_the_edge_of_the_map(field: GroundMap | None) -> None:
    assert field is not None
    assert field.file is not None
    field.file.close()
    answer = ask(field, "/api/v1/map/3/1/1")
    assert answer.status_code == 503
    assert "the map cannot be read" in answer.json()["detail"]


def test_tiles_do_not_use_up_the_rate_of_commands(field: GroundMap | None) -> None:
    authorization = Authorization(calls_per_s=1e-6, burst=1.0)
    codes = [ask(field, path, authorization).status_code for path in ("/api/v1/map/3/1/1",) * 2]
    assert codes == [200, 429]
    assert ask(field, "/api/v1/status", authorization).status_code == 200


@pytest.mark.parametrize(
    ("place", "field_name"),
    [
        *(("3/8/0", "x"), ("3/0/8", "y"), ("3/-1/0", "x"), ("-1/0/0", "z"), ("23/0/0", "z")),
        *((f"{10**40}/0/0", "z"), ("a/0/0", "z"), ("3/1.5/0", "x"), ("3/1/1.png", "y"), ("nan/0/0", "z")),
    ],
)
def test_impossible_tile_numbers_are_refused(field: GroundMap | None, place: str, field_name: str) -> None:
    answer = ask(field, f"/api/v1/map/{place}")
    assert answer.status_code == 422
    assert field_name in answer.json()["problems"][0]["field"]


def test_tile_needs_the_right_to_view(field: GroundMap | None, tmp_path: Path) -> None:
    file = tmp_path / "tokens.json"
    token = create_token(file, "guest", Role.WATCH)
    authorization = Authorization(Tokens(file))
    assert ask(field, "/api/v1/map/3/1/1", authorization).status_code == 401
    assert ask(field, "/api/v1/map/3/1/1", authorization, token).content == PICTURE


def test_page_may_fetch_from_the_configured_origin_only(field: GroundMap | None, tmp_path: Path) -> None:
    assets = tmp_path / "assets"
    assets.mkdir()
    (assets / "a.js").write_text("fly()")
    (tmp_path / "index.html").write_text("page")

    def policies(ground: GroundMap | None) -> set[str]:
        app = create_app(FakeService(), console=tmp_path, ground=ground)

        async def both() -> set[str]:
            transport = httpx.ASGITransport(app)
            async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
                answers = [await client.get(path) for path in ("/", "/assets/a.js")]
            return {answer.headers["content-security-policy"] for answer in answers}

        return asyncio.run(both())

    ours = (
        "default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    assert policies(None) == policies(field) == {ours}
    widened = {f"{ours}; connect-src 'self' https://maps.example:8443"}
    assert policies(open_map(MapSettings(tiles=ADDRESS))) == widened
