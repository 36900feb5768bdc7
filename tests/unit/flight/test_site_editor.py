"""The site of a running service: read, changed on the ground, and no start until it is in force."""

import asyncio
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from gcs.areas.files.geojson import write
from gcs.areas.files.site_files import read_site, written
from gcs.areas.site import AreaKind, FlightSite
from gcs.flight.commands.site_editor import SiteEditor
from gcs.flight.state.feature import Instant
from gcs.model.errors import InvalidError, RefusedError, UnknownError
from gcs.model.lifecycle import ShowPhase
from gcs.service import SiteFormat
from tests.support.fields import ELL, ORIGIN, area, field

SITE = field()
SMALLER = field(top_m=40.0)
INSTANT = Instant(0.0, ShowPhase.IDLE, None)


class Ground:
    """Why the site cannot be changed, and why a site does not fit."""

    def __init__(self) -> None:
        self.why = ""
        self.misfits: Sequence[str] = ()

    def misfit(self, _site: FlightSite, _path: Path) -> Sequence[str]:
        return self.misfits


def editor(folder: Path, name: str = "field.geojson") -> tuple[SiteEditor, Path, Ground]:
    path, ground = folder / name, Ground()
    path.write_bytes(written(SITE, path))
    return SiteEditor(path, SITE, ORIGIN, ground.misfit, lambda: ground.why), path, ground


def refused_start(site: SiteEditor) -> str:
    (check,) = site.checks(INSTANT)
    assert check.passes == (check.problem == "")
    return check.problem


def test_areas_are_given_in_both_frames(tmp_path: Path) -> None:
    site, _, _ = editor(tmp_path)
    view = asyncio.run(site.read())
    geography, people = view.areas
    assert (view.name, view.file) == ("corner field", "field.geojson")
    assert (view.hash, view.in_force, view.pending) == (SITE.digest, SITE.digest, "")
    assert (geography.kind, people.kind) == ("flight-geography", "audience")
    assert [(round(at.x_m), round(at.y_m)) for at in geography.corners] == [*ELL]
    assert tuple((at.latitude_deg, at.longitude_deg) for at in people.corners) == SITE.areas[1].corners
    assert (geography.height_max_m, people.height_max_m) == (45.0, None)


def test_a_change_is_stored_and_no_start_is_possible(tmp_path: Path) -> None:
    site, path, _ = editor(tmp_path)

    async def change() -> None:
        assert refused_start(site) == ""
        before, old = await site.read(), path.read_bytes()
        after = await site.change(write(SMALLER), before.version)
        assert read_site(path).digest == after.hash == SMALLER.digest
        assert (after.in_force, after.version != before.version) == (SITE.digest, True)
        assert path.with_name("field.geojson.bak").read_bytes() == old
        assert "not the one in force" in refused_start(site)
        back = await site.change(write(SITE), after.version)
        assert (back.pending, refused_start(site)) == ("", "")

    asyncio.run(change())
    assert sorted(each.name for each in tmp_path.iterdir()) == ["field.geojson", "field.geojson.bak"]


def test_the_file_keeps_its_own_format(tmp_path: Path) -> None:
    for name in ("field.kml", "field.plan"):
        site, path, _ = editor(tmp_path, name)
        version = asyncio.run(site.read()).version
        asyncio.run(site.change(write(SMALLER), version))
        assert read_site(path).digest == SMALLER.digest
        assert path.suffix in {".kml", ".plan"}


def test_of_two_editors_the_second_is_refused(tmp_path: Path) -> None:
    site, path, _ = editor(tmp_path)

    async def both() -> None:
        version = (await site.read()).version
        answers = await asyncio.gather(
            *(site.change(write(field(top_m=top_m)), version) for top_m in (41.0, 42.0)),
            return_exceptions=True,
        )
        assert isinstance(answers[1], RefusedError)
        assert "was changed since you read it" in str(answers[1])

    asyncio.run(both())
    assert read_site(path).digest == field(top_m=41.0).digest


def test_a_name_alone_counts_as_a_change_but_is_in_force(tmp_path: Path) -> None:
    site, path, _ = editor(tmp_path)

    async def rename() -> None:
        before = await site.read()
        after = await site.change(write(FlightSite("another name", SITE.areas)), before.version)
        assert (after.hash, after.pending) == (before.hash, "")
        assert after.version != before.version

    asyncio.run(rename())
    assert read_site(path).name == "another name"


def test_nothing_is_changed_in_the_air(tmp_path: Path) -> None:
    site, path, ground = editor(tmp_path)
    version = asyncio.run(site.read()).version
    ground.why, old = "3 vehicles fly", path.read_bytes()
    with pytest.raises(RefusedError, match="3 vehicles fly"):
        asyncio.run(site.change(write(SMALLER), version))
    assert (path.read_bytes(), refused_start(site)) == (old, "")
    assert asyncio.run(site.read()).hash == SITE.digest


def swapped() -> bytes:
    document = json.loads(write(SITE))
    ring = document["features"][0]["geometry"]["coordinates"][0]
    ring[1], ring[2] = ring[2], ring[1]
    return json.dumps(document).encode()


def with_areas(*rows: int) -> bytes:
    """The field with some of its areas, in this order."""
    document = json.loads(write(SITE))
    document["features"] = [document["features"][row] for row in rows]
    return json.dumps(document).encode()


BAD: list[tuple[bytes, str]] = [
    (b"", "JSON"),
    (b"\xff\xfe", "site"),
    (b"[1, 2]", "site"),
    (b'{"type": "FeatureCollection", "features": []}', "no area of kind flight-geography"),
    (with_areas(0, 1, 0), "2 areas of kind flight-geography: draw one polygon"),
    (with_areas(1), "no area of kind flight-geography"),
    (with_areas(0, *[1] * 12), "13 areas: at most 12"),
    (swapped(), r"area 1, flight-geography .*side \d-\d and side \d-\d"),
    (b" " * 1_000_001, "at most 1000000 bytes"),
]


@pytest.mark.parametrize(("text", "words"), BAD, ids=[words[:20] for _, words in BAD])
def test_a_bad_site_is_refused_in_words(tmp_path: Path, text: bytes, words: str) -> None:
    site, path, _ = editor(tmp_path)
    version, old = asyncio.run(site.read()).version, path.read_bytes()
    with pytest.raises(InvalidError, match=words):
        asyncio.run(site.change(text, version))
    assert (path.read_bytes(), refused_start(site)) == (old, "")


def test_every_problem_is_a_line_with_its_area(tmp_path: Path) -> None:
    site, _, _ = editor(tmp_path)
    document: Any = json.loads(write(field(area(AreaKind.NO_FLY, ((0, 0), (0, 9), (9, 9))))))
    for row in (0, 2):
        document["features"][row]["properties"]["height_max_m"] = -100.0
    with pytest.raises(InvalidError) as refused:
        asyncio.run(site.change(json.dumps(document).encode(), asyncio.run(site.read()).version))
    lines = refused.value.allowed.splitlines()
    assert [line.partition(",")[0] for line in lines] == ["area 1", "area 3"]


def test_a_site_that_the_configuration_cannot_fly_is_refused(tmp_path: Path) -> None:
    site, path, ground = editor(tmp_path)
    ground.misfits = ("the first formation does not fit",)
    version, old = asyncio.run(site.read()).version, path.read_bytes()
    with pytest.raises(InvalidError, match="the first formation does not fit"):
        asyncio.run(site.change(write(SMALLER), version))
    assert path.read_bytes() == old


def test_whole_areas_are_added_and_removed(tmp_path: Path) -> None:
    site, path, _ = editor(tmp_path)
    mast = area(AreaKind.NO_FLY, ((0, 0), (0, 9), (9, 9)), name="mast")

    async def change() -> None:
        added = await site.change(write(FlightSite("corner field", (*SITE.areas, mast))), await version())
        assert [each.name for each in added.areas] == ["flight-geography", "audience", "mast"]
        removed = await site.change(write(FlightSite("corner field", (SITE.areas[0], mast))), added.version)
        assert [each.name for each in removed.areas] == ["flight-geography", "mast"]
        assert removed.hash not in {SITE.digest, added.hash}
        assert read_site(path).digest == removed.hash

    async def version() -> str:
        return (await site.read()).version

    asyncio.run(change())


def test_a_file_that_cannot_be_written_changes_nothing(tmp_path: Path) -> None:
    site, path, _ = editor(tmp_path)
    version, old = asyncio.run(site.read()).version, path.read_bytes()
    path.with_name("field.geojson.part").mkdir()
    with pytest.raises(RefusedError, match=r"cannot be written.*nothing has changed"):
        asyncio.run(site.change(write(SMALLER), version))
    assert (path.read_bytes(), refused_start(site)) == (old, "")


def test_a_file_that_was_changed_by_hand_counts_once_read(tmp_path: Path) -> None:
    site, path, _ = editor(tmp_path)
    path.write_bytes(written(SMALLER, path))
    assert asyncio.run(site.read()).pending != ""
    assert "not the one in force" in refused_start(site)
    path.write_text("{}")
    with pytest.raises(RefusedError, match="cannot be used, correct it"):
        asyncio.run(site.read())
    path.unlink()
    with pytest.raises(RefusedError, match="cannot be read"):
        asyncio.run(site.read())


def test_without_a_site_there_is_nothing_to_read_or_check() -> None:
    site = SiteEditor(None, None, ORIGIN, Ground().misfit, lambda: "")
    for call in (site.read(), site.text("kml"), site.change(b"", "")):
        with pytest.raises(UnknownError, match=r"site: FILE\.geojson"):
            asyncio.run(call)
    assert [*site.checks(INSTANT)] == []
    assert site.view(INSTANT) is None


def test_the_site_is_given_in_each_format(tmp_path: Path) -> None:
    site, _, _ = editor(tmp_path)
    begins: dict[SiteFormat, bytes] = {"geojson": b"{", "kml": b"<?xml", "plan": b"{"}
    for form, first in begins.items():
        assert asyncio.run(site.text(form)).startswith(first)
