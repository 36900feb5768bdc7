"""The console's page, as a browser asks for it."""

import asyncio
import gzip
from pathlib import Path
from typing import NamedTuple

import httpx
import pytest

from gcs.api.app import create_app
from gcs.api.auth.authorization import Authorization, needed
from gcs.api.auth.tokens import Tokens, create_token
from gcs.api.console_files import DIST
from gcs.service.access import Right, Role
from tests.support.api_fake_service import FakeService

SCRIPT = "index-Ccg8Q6D7.js"


@pytest.fixture
def built(tmp_path: Path) -> Path:
    assets = tmp_path / "dist" / "assets"
    assets.mkdir(parents=True)
    (assets / SCRIPT).write_text("fly()")
    (assets.parent / "index.html").write_text(f"<script src=/assets/{SCRIPT}></script>")
    (assets.parent / "secret.js").write_text("classified")
    (assets / "deeper").mkdir()
    (assets / "deeper" / "secret.js").write_text("classified")
    (tmp_path / "secret.js").write_text("classified")
    return assets.parent


def ask(folder: Path, path: str, method: str = "GET") -> httpx.Response:
    """Of a service that demands tokens: the page is for whoever has none yet."""
    file = folder.parent / "tokens.json"
    if not file.exists():
        create_token(file, "crew", Role.WATCH)
    app = create_app(FakeService(), authorization=Authorization(Tokens(file)), console=folder)

    async def once() -> httpx.Response:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return await client.request(method, path)

    return asyncio.run(once())


class Sent(NamedTuple):
    """An answer with its bytes as they were sent, still compressed."""

    status_code: int
    headers: httpx.Headers
    content: bytes


def raw(folder: Path, path: str, headers: dict[str, str]) -> Sent:
    """What is answered to exactly these headers."""
    app = create_app(FakeService(), console=folder)

    async def once() -> Sent:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app)) as client:
            request = httpx.Request("GET", f"http://127.0.0.1{path}", headers=headers)
            answer = await client.send(request, stream=True)
            content = b"".join([part async for part in answer.aiter_raw()])
            return Sent(answer.status_code, answer.headers, content)

    return asyncio.run(once())


def test_page_is_revalidated_and_its_assets_are_cached(built: Path) -> None:
    page, script = ask(built, "/"), ask(built, f"/assets/{SCRIPT}")
    assert (page.status_code, page.text) == (200, f"<script src=/assets/{SCRIPT}></script>")
    assert page.headers["cache-control"] == "no-cache"
    assert (script.status_code, script.text) == (200, "fly()")
    assert script.headers["cache-control"] == "public, max-age=31536000, immutable"
    assert script.headers["content-type"].startswith("text/javascript")
    for answer in (page, script):
        assert answer.headers["x-content-type-options"] == "nosniff"
        policy = answer.headers["content-security-policy"]
        assert "default-src 'self';" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy


@pytest.mark.parametrize("path", ["/", f"/assets/{SCRIPT}"])
def test_a_page_is_only_read(built: Path, path: str) -> None:
    head = ask(built, path, "HEAD")
    assert (head.status_code, head.content) == (200, b"")
    assert ask(built, path, "POST").status_code == 401


BAD = [
    *("/assets/", "/assets", "/assets/.", "/assets/secret.js", "/assets/deeper"),
    *("/assets/%2e%2e/secret.js", "/assets/..%2fsecret.js"),
    *("/assets/..%2f..%2fsecret.js", "/assets//secret.js", "/assets/deeper/secret.js"),
    *("/assets/deeper%2fsecret.js", "/assets/..%5csecret.js", f"/assets/{SCRIPT}/", f"/assets/{SCRIPT}%00"),
    *(f"/assets/{SCRIPT}%0a", "/secret.js", "/index.html", "/assets/%ff.js"),
    "/assets/" + "a" * 300 + ".js",
]


@pytest.mark.parametrize("path", BAD)
def test_without_a_token_nothing_but_the_page_is_served(built: Path, path: str) -> None:
    answer = ask(built, path)
    assert answer.status_code in {401, 404}
    assert "classified" not in answer.text


@pytest.mark.parametrize("path", ["/assets/..", "/assets/../secret.js", "//", "/..", "/assets/a/../b.js"])
def test_a_path_with_dots_that_no_browser_sends_is_not_the_page(path: str) -> None:
    assert needed("GET", path) is Right.WATCH


def test_page_that_is_not_built_explains_how_to_build_it(tmp_path: Path) -> None:
    answer = ask(tmp_path / "dist", "/")
    assert (answer.status_code, answer.headers["content-type"]) == (503, "application/json")
    assert "make console" in answer.text
    assert ask(tmp_path / "dist", "/assets/index.js").status_code == 404


def test_built_page_has_no_inline_code_and_existing_assets() -> None:
    text = (DIST / "index.html").read_text(encoding="utf-8")
    names = [part.partition('"')[0] for part in text.split('"/assets/')[1:]]
    assert len(names) >= 2
    assert all((DIST / "assets" / name).is_file() for name in names)
    assert "://" not in text
    assert "<style" not in text
    assert all(script.startswith(' type="module" crossorigin src=') for script in text.split("<script")[1:])


@pytest.fixture
def compressed(built: Path) -> Path:
    """The same with compressed twins; each tells which it is."""
    script = built / "assets" / SCRIPT
    script.with_name(SCRIPT + ".br").write_bytes(b"brotli")
    script.with_name(SCRIPT + ".gz").write_bytes(gzip.compress(script.read_bytes()))
    return built


@pytest.mark.parametrize(
    ("accepted", "coding"),
    [
        ("gzip, deflate, br, zstd", "br"),
        ("gzip, deflate", "gzip"),
        ("GZip", "gzip"),
        ("br;q=0, gzip", "gzip"),
        ("br;q=0.5, gzip;q=0.8", "gzip"),
        ("br; q=1.0, gzip;q=0.8, *;q=0.1", "br"),
        ("*", "br"),
        ("*;q=0, gzip", "gzip"),
        ("identity;q=0, br", "br"),
        ("identity, br;q=0.5", None),
        ("br;q=0, gzip;q=0", None),
        ("br;q=wrong", None),
        ("deflate", None),
        ("", None),
        (None, None),
    ],
)
def test_script_has_the_encoding_that_the_caller_accepts(
    compressed: Path, accepted: str | None, coding: str | None
) -> None:
    with_header = {} if accepted is None else {"accept-encoding": accepted}
    answer = raw(compressed, f"/assets/{SCRIPT}", with_header)
    assert answer.status_code == 200
    assert answer.headers.get("content-encoding") == coding
    assert answer.headers["vary"] == "Accept-Encoding"
    assert answer.headers["content-type"].startswith("text/javascript")
    sent = {"br": b"brotli", None: b"fly()"}
    if coding == "gzip":
        assert gzip.decompress(answer.content) == b"fly()"
    else:
        assert answer.content == sent[coding]
    assert int(answer.headers["content-length"]) == len(answer.content)


@pytest.mark.parametrize("refused", ["identity;q=0", "*;q=0", "br;q=0, gzip;q=0, identity;q=0"])
def test_request_without_acceptable_encoding_lists_encodings(compressed: Path, refused: str) -> None:
    answer = raw(compressed, f"/assets/{SCRIPT}", {"accept-encoding": refused})
    assert answer.status_code == 406
    assert b"br, gzip or identity" in answer.content
    assert answer.headers["vary"] == "Accept-Encoding"


def test_each_encoding_has_its_etag_and_a_match_is_not_resent(compressed: Path) -> None:
    path = f"/assets/{SCRIPT}"
    forms = {
        coding: raw(compressed, path, {"accept-encoding": coding}) for coding in ("br", "gzip", "identity")
    }
    tags = {coding: answer.headers["etag"] for coding, answer in forms.items()}
    assert len(set(tags.values())) == 3
    for coding, tag in tags.items():
        for known in (tag, f'"other", W/{tag}', "*"):
            again = raw(compressed, path, {"accept-encoding": coding, "if-none-match": known})
            assert (again.status_code, again.content) == (304, b"")
            assert again.headers["etag"] == tag
            assert again.headers["vary"] == "Accept-Encoding"
            assert "immutable" in again.headers["cache-control"]
    other = raw(compressed, path, {"accept-encoding": "br", "if-none-match": tags["gzip"]})
    assert (other.status_code, other.content) == (200, b"brotli")


@pytest.mark.parametrize("ending", [".br", ".gz"])
def test_compressed_file_is_no_asset_of_its_own(compressed: Path, ending: str) -> None:
    assert ask(compressed, f"/assets/{SCRIPT}{ending}").status_code == 404


def test_built_page_is_compressed_to_equal_bytes() -> None:
    scripts = [file for file in (DIST / "assets").iterdir() if file.suffix in {".js", ".css"}]
    assert scripts
    for file in scripts:
        plain = file.read_bytes()
        packed = raw(DIST, f"/assets/{file.name}", {"accept-encoding": "gzip"})
        assert packed.headers["content-encoding"] == "gzip"
        assert gzip.decompress(packed.content) == plain
        smallest = raw(DIST, f"/assets/{file.name}", {"accept-encoding": "gzip, br"})
        assert smallest.headers["content-encoding"] == "br"
        assert len(smallest.content) < len(packed.content) < 0.4 * len(plain)
        assert raw(DIST, f"/assets/{file.name}", {}).content == plain
