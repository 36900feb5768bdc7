"""The console's page, as a browser asks for it."""

import asyncio
from pathlib import Path

import httpx
import pytest
from api_fake_service import FakeService

from api.app import create_app
from api.door import Door, needed
from api.page import DIST
from gcs.access import Right, Role
from gcs.tokens import Tokens, create_token

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
    app = create_app(FakeService(), door=Door(Tokens(file)), console=folder)

    async def once() -> httpx.Response:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return await client.request(method, path)

    return asyncio.run(once())


def test_the_page_is_asked_for_anew_its_assets_are_kept(built: Path) -> None:
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
def test_nothing_else_is_told_to_whoever_has_no_token(built: Path, path: str) -> None:
    answer = ask(built, path)
    assert answer.status_code in {401, 404}
    assert "classified" not in answer.text


@pytest.mark.parametrize("path", ["/assets/..", "/assets/../secret.js", "//", "/..", "/assets/a/../b.js"])
def test_a_path_with_dots_that_no_browser_sends_is_not_the_page(path: str) -> None:
    assert needed("GET", path) is Right.WATCH


def test_where_the_page_is_not_built_a_sentence_says_how(tmp_path: Path) -> None:
    answer = ask(tmp_path / "dist", "/")
    assert (answer.status_code, answer.headers["content-type"]) == (503, "text/plain; charset=utf-8")
    assert "make console" in answer.text
    assert ask(tmp_path / "dist", "/assets/index.js").status_code == 404


def test_the_page_that_is_built_here_runs_nothing_inline_and_names_assets_that_are_there() -> None:
    text = (DIST / "index.html").read_text(encoding="utf-8")
    names = [part.partition('"')[0] for part in text.split('"/assets/')[1:]]
    assert len(names) >= 2
    assert all((DIST / "assets" / name).is_file() for name in names)
    assert "://" not in text
    assert "<style" not in text
    assert all(script.startswith(' type="module" crossorigin src=') for script in text.split("<script")[1:])
