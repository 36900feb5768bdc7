"""The map under the show: a file of the service's own, another server's, or none, and no server is asked."""

import io
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from math import asinh, pi, radians, tan
from pathlib import Path
from struct import pack
from threading import Thread
from typing import Any, Final

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, expect

from gcs.api.auth.tokens import create_token
from gcs.config import schema as configuration
from gcs.service.access import Role
from tests.support.console_bench import SOON_MS, Console, console, station
from tests.support.mbtiles import mbtiles

pytestmark = pytest.mark.soak

FRAME: Final = configuration.load(configuration.find("demo")).show_frame
ZOOMS: Final = (13, 14, 15)
AROUND: Final = 4  # tiles to each side
SIDE_PX: Final = 256

COLORS: Final = {"north-west": 0, "north-east": 1, "south-west": 2, "south-east": 3}
RGB: Final = np.array([[255, 255, 0], [255, 0, 0], [0, 0, 255], [0, 255, 0]], np.uint8)
"""Of the four quarters around the show's origin."""


def png(colors: Any) -> bytes:
    """A picture of numbers of RGB, (rows, columns)."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return pack(">I", len(data)) + kind + data + pack(">I", zlib.crc32(kind + data))

    rows, columns = colors.shape
    lines = np.zeros((rows, columns + 1), np.uint8)  # each begins with its filter: none
    lines[:, 1:] = colors
    header = pack(">2I5B", columns, rows, 8, 3, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"PLTE", RGB.tobytes())
    return (
        b"\x89PNG\r\n\x1a\n" + body + chunk(b"IDAT", zlib.compress(lines.tobytes(), 1)) + chunk(b"IEND", b"")
    )


def quarters(zoom: int) -> dict[tuple[int, int, int], bytes]:
    """Tiles around the show's origin, each quarter in its colour; rows counted from the north."""
    origin_x = (FRAME.longitude_deg / 360 + 0.5) * 2**zoom
    origin_y = (0.5 - asinh(tan(radians(FRAME.latitude_deg))) / (2 * pi)) * 2**zoom
    within = (np.arange(SIDE_PX) + 0.5) / SIDE_PX
    return {
        (zoom, x, y): png((x + within > origin_x)[None, :] + 2 * (y + within > origin_y)[:, None])
        for x in range(int(origin_x) - AROUND, int(origin_x) + AROUND + 1)
        for y in range(int(origin_y) - AROUND, int(origin_y) + AROUND + 1)
    }


TILES: Final = {place: tile for zoom in ZOOMS for place, tile in quarters(zoom).items()}


def asked(ui: Console) -> list[str]:
    """Every address that the page has asked for."""
    found: list[str] = ui.page.evaluate("performance.getEntriesByType('resource').map((each) => each.name)")
    return found


def seen(ui: Console) -> dict[str, str]:
    """Which quarter's colour lies where on the screen, seen from above, around the middle."""
    free = "(({ left, top, right, bottom }) => [left, top, right, bottom])"
    room = "document.querySelector('[data-room]').getBoundingClientRect()"
    left, top, right, bottom = ui.page.evaluate(f"{free}({room})")
    picture = np.asarray(Image.open(io.BytesIO(ui.page.screenshot())).convert("RGB")).astype(np.int64)
    across, down = int(left + right) // 2, int(top + bottom) // 2
    found = {}
    for name in COLORS:
        x = across + (90 if "east" in name else -90)
        y = down + (90 if "south" in name else -90)
        color = np.median(picture[y - 20 : y + 20, x - 20 : x + 20].reshape(-1, 3), axis=0)
        likeness = (RGB - RGB.mean(axis=1, keepdims=True)) @ (color - color.mean())
        found[name] = list(COLORS)[int(likeness.argmax())] if np.ptp(color) > 20 else f"grey {color}"
    return found


def let_in(ui: Console, token: str) -> None:
    """By the token, which the page asks for."""
    ui.part("token").fill(token)
    ui.page.keyboard.press("Enter")
    ui.says("connection", "Live")


def wrong(ui: Console) -> list[str]:
    """What the browser found wrong, but that the first call had no token."""
    return [each for each in ui.wrong if "401" not in each]


def from_above(ui: Console) -> None:
    """North is up, and so much is seen that the middle is as good as the show's origin."""
    ui.press("camera-top")
    ui.page.locator("#view").focus()
    for _ in range(12):
        ui.page.keyboard.press("-")


@pytest.mark.soak
def test_map_file_lies_under_the_show_by_compass(chrome: Browser, tmp_path: Path) -> None:
    rows = {(z, x, 2**z - 1 - y): tile for (z, x, y), tile in TILES.items()}
    reported = {"format": "png", "minzoom": ZOOMS[0], "maxzoom": ZOOMS[-1], "attribution": "&copy; Crew"}
    file = mbtiles(tmp_path / "field.mbtiles", reported, rows)
    tokens = tmp_path / "tokens.json"
    token = create_token(tokens, "guest", Role.WATCH)
    given: dict[str, Any] = {"access": {"tokens_file": str(tokens)}, "ground": {"tiles": str(file)}}
    with station(tmp_path, 1, heading_deg=30.0, **given) as ground, console(chrome, ground.url) as ui:
        let_in(ui, token)
        from_above(ui)
        ui.says("map-credit", "© Crew")
        expect(ui.part("map-credit")).to_have_text("© Crew")
        found: dict[str, str] = {}
        for _ in range(40):
            found = seen(ui)
            if found == {name: name for name in COLORS}:
                break
            ui.page.wait_for_timeout(500)
        assert found == {name: name for name in COLORS}
        tiles = [each for each in asked(ui) if "/map/" in each]
        assert 4 <= len(tiles) == len(set(tiles))
        assert all(each.startswith(ground.url) for each in asked(ui))
        assert ui.findings() == []
        assert wrong(ui) == []


class Tiles(BaseHTTPRequestHandler):
    """Somebody else's map server; what it was asked for is kept in `received`."""

    received: list[tuple[str, dict[str, str]]]
    broken: bool

    def do_GET(self) -> None:
        """A tile, as other pages may read it too."""
        self.received.append((self.path, {name.lower(): value for name, value in self.headers.items()}))
        z, x, y = (int(part) for part in self.path.strip("/").removesuffix(".png").split("/"))
        tile = None if self.broken else TILES.get((z, x, y))
        self.send_response(503 if self.broken else 404 if tile is None else 200)
        self.send_header("Access-Control-Allow-Origin", "*")
        self.send_header("Content-Length", str(len(tile or b"")))
        self.end_headers()
        self.wfile.write(tile or b"")

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@contextmanager
def map_server() -> Iterator[tuple[str, type[Tiles]]]:
    """Its template, and what it does and the messages it received."""
    kind = type("Kept", (Tiles,), {"received": [], "broken": False})
    server = ThreadingHTTPServer(("127.0.0.1", 0), kind)
    thread = Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/{{z}}/{{x}}/{{y}}.png", kind
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.mark.soak
def test_another_server_is_fetched_only_for_tiles(chrome: Browser, tmp_path: Path) -> None:
    tokens = tmp_path / "tokens.json"
    token = create_token(tokens, "guest", Role.WATCH)
    with map_server() as (template, server):
        section = {"tiles": template, "attribution": "© Example <b>", "zoom_max": ZOOMS[-1]}
        with station(tmp_path, 1, access={"tokens_file": str(tokens)}, ground=section) as ground:
            with console(chrome, ground.url) as ui:
                let_in(ui, token)
                ui.says("map-credit", "© Example <b>")
                assert wrong(ui) == []
            server.broken = True
            with console(chrome, ground.url) as ui:
                let_in(ui, token)
                ui.says("map-credit", "A part of the map is missing: it was answered 503")
                ui.says("connection", "Live")
                ui.page.wait_for_timeout(3000)
                # As this page counts: requests of the closed one may reach the server late, beside these.
                tiles = [each for each in asked(ui) if not each.startswith(ground.url)]
                assert 0 < len(tiles) == len(set(tiles)) <= 64  # each once, and not again so soon
                expect(ui.part("toast-refused")).to_have_count(0)
        for _, headers in server.received:
            assert not {"authorization", "cookie"} & set(headers)
            assert token not in str(headers)


def test_without_a_map_nothing_is_fetched(chrome: Browser, tmp_path: Path) -> None:
    with station(tmp_path, 1) as ground, console(chrome, ground.url) as ui:
        ui.says("connection", "Live")
        from_above(ui)
        expect(ui.part("row-d1")).to_be_visible(timeout=SOON_MS)
        ui.page.wait_for_timeout(2000)
        expect(ui.part("map-credit")).to_be_hidden()
        assert all(each.startswith(ground.url) and "/map/" not in each for each in asked(ui))
        assert ui.wrong == []
