"""Shows between stations: what arrives is unpacked outside control's process, whatever it contains."""

import json
import zlib
from base64 import b64encode
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from gcs.model.errors import RefusedError
from gcs.shows import Show
from gcs.shows.library import ShowLibrary
from gcs.shows.loading import parse
from gcs.shows.packed import UNPACKED_MAX_BYTES, packed, unpacked_apart
from gcs.site.arrivals import ShowArrivals
from gcs.site.requests import PART_MAX, ShowPart
from tests.support.work import lines_run
from tests.support.written_show import NAME, TEXT


def written() -> Show:
    found = parse(TEXT, NAME).show
    assert found is not None
    return found


def as_text(content: str) -> str:
    return b64encode(zlib.compress(content.encode())).decode()


def of(timeline: object) -> str:
    return as_text(json.dumps({"name": NAME, "show": {"timeline": timeline}, "figures": None}))


JUNK: dict[str, Callable[[], str]] = {
    "no-base64": lambda: "%%%",
    "no-archive": lambda: b64encode(b"junk").decode(),
    "no-json": lambda: as_text("junk"),
    "another-show": lambda: packed(NAME, written(), None),
    "many-errors": lambda: of([[[]]] * 60_000),
    "deep": lambda: as_text("[" * 400_000),
    "bomb": lambda: as_text("[" + "1," * 20_000_000),
}


def test_a_show_is_the_same_on_the_other_side() -> None:
    show = written()
    assert unpacked_apart(packed(NAME, show, None), show.digest) == (NAME, show, None)


@pytest.mark.keeps("bomb")
@pytest.mark.parametrize("junk", JUNK.values(), ids=list(JUNK))
def test_junk_is_refused_with_its_reason(junk: Callable[[], str]) -> None:
    with pytest.raises(RefusedError, match="the show that arrived"):
        unpacked_apart(junk(), "f" * 64)


def test_a_show_that_no_station_would_unpack_is_not_sent() -> None:
    cues = written().timeline * 100
    lights = ("#ff0000",) * 300
    large = written().model_copy(
        update={"timeline": tuple(c.model_copy(update={"lights": lights}) for c in cues)}
    )
    with pytest.raises(RefusedError, match="too large for the bus"):
        packed(NAME, large, None)


class Held(ThreadPoolExecutor):
    """Notes what was submitted, and has not begun with it."""

    def __init__(self) -> None:
        super().__init__(1)
        self.futures: list[Future[Any]] = []

    def submit(self, function: Any, /, *given: Any, **named: Any) -> "Future[Any]":
        self.futures.append(Future())
        return self.futures[-1]


def test_junk_of_a_station_is_no_work_for_control(tmp_path: Path) -> None:
    """All parts of the largest show, again and again: one is unpacked at a time."""
    held = Held()
    arrivals = ShowArrivals(ShowLibrary(tmp_path), held)
    text = of([[[]]] * 60_000).ljust(16 * PART_MAX, "A")
    parts = [
        ShowPart(f"{turn:064x}", at // PART_MAX, 16, text[at : at + PART_MAX])
        for turn in range(20)
        for at in range(0, len(text), PART_MAX)
    ]

    def take() -> None:
        for part in parts:
            arrivals.take(part)
        assert arrivals.find(parts[-1].hash, 0.0) is None

    assert lines_run(take) < 20 * len(parts)
    assert len(held.futures) == 1
    assert arrivals.has(parts[0].hash)
    assert arrivals.has(parts[-1].hash), "the newest waits"
    held.futures[0].set_result("the show that arrived cannot be read")
    assert arrivals.find(parts[-1].hash, 0.0) is None
    assert len(held.futures) == 2
    assert not arrivals.has(parts[0].hash)


def test_the_bound_is_that_of_the_table() -> None:
    text = (Path(__file__).parents[3] / "docs" / "invariants.md").read_text(encoding="utf-8")
    (row,) = (line for line in text.splitlines() if line.startswith("| shows of other stations"))
    assert f"{UNPACKED_MAX_BYTES / 1e6:g} MB unpacked" in row
