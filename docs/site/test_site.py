"""The built site, as a reader opens it from the disk. `make docs` runs this."""

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Final

SITE: Final = Path(__file__).parents[2] / "build" / "site"
LOADED: Final = {
    "audio": "src",
    "embed": "src",
    "iframe": "src",
    "img": "src",
    "object": "data",
    "script": "src",
    "source": "src",
    "video": "src",
}
NO_REQUEST: Final = {"canonical", "next", "prev"}
OTHER_HOST: Final = re.compile(r"^(?:[a-z]+:)?//", re.IGNORECASE)
IN_STYLES: Final = re.compile(r"""(?:@import\s+|url\()\s*["']?((?:https?:)?//[^"')\s]+)""")


class Sources(HTMLParser):
    """What a page loads by itself, and whether the theme asks the repository's host for its figures."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        asked = tag == "link" and values.get("rel") not in NO_REQUEST
        if asked or values.get("data-md-component") == "source":
            self.found.append(values.get("href", ""))
        elif tag in LOADED:
            self.found.append(values.get(LOADED[tag], ""))


def sources(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".css":
        return IN_STYLES.findall(text)
    parser = Sources()
    parser.feed(text)
    return parser.found + IN_STYLES.findall(text)


def test_no_page_names_another_host() -> None:
    pages = [*SITE.rglob("*.html"), *SITE.rglob("*.css")]
    assert len(pages) > 100
    named = {
        str(path.relative_to(SITE)): each
        for path in pages
        for each in sources(path)
        if OTHER_HOST.match(each)
    }
    assert named == {}
