"""A map is an address or a file of pictures, or refused with what is wrong and what would be right."""

import os
import sqlite3
from pathlib import Path
from typing import Any

import pytest
import yaml

from gcs.api.map_tiles import TILE_MOST_BYTES, TileFile, open_map
from gcs.cli.replay import recorded_map
from gcs.cli.service.serve import map_problems
from gcs.config.schema import parse
from gcs.model.errors import ConfigError, InvalidError, UnknownError
from gcs.service.map_settings import MapSettings
from tests.support.mbtiles import mbtiles

SMALLEST = """
show_frame: {latitude_deg: 47.0, longitude_deg: 8.0, altitude_amsl_m: 400.0}
links: [{name: one, listen: "udpin://127.0.0.1:14540", vehicles: [{id: a, system_id: 1}]}]
formation: {radius_m: 10.0, height_m: 20.0}
"""

ADDRESS = "https://maps.example:8443/tiles/{z}/{x}/{y}.png?key=a"


def configured(**settings: object) -> MapSettings | None:
    return parse(SMALLEST + yaml.safe_dump({"map": settings}), "my.yaml").map


def test_without_a_section_there_is_no_map() -> None:
    assert open_map(parse(SMALLEST, "my.yaml").map) is None


def test_tile_address_is_fetched_by_the_page_and_named() -> None:
    ground = open_map(configured(tiles=ADDRESS, attribution="© Example", zoom_max=17))
    assert ground is not None
    assert (ground.tiles, ground.attribution, ground.zoom_min, ground.zoom_max) == (
        ADDRESS,
        "© Example",
        0,
        17,
    )
    assert ground.origin == "https://maps.example:8443"
    assert ground.file is None


@pytest.mark.parametrize(
    ("tiles", "stated"),
    [
        ("map.png", "path of an .mbtiles file"),
        ("", "path of an .mbtiles file"),
        ("https://maps.example/{x}/{y}.png", "{z} is missing"),
        ("https://maps.example/{z}/{x}/{-y}.png", "{y} is missing"),
        ("https://maps.example/{z}/{x}/{y}{r}.png", "{r} is not filled in"),
        ("https://{s}.maps.example/{z}/{x}/{y}.png", "no host"),
        ("ftp://maps.example/{z}/{x}/{y}.png", "ftp:// cannot request a tile"),
        ("file:///maps/{z}/{x}/{y}.png", "file:// cannot request a tile"),
        ("https:///{z}/{x}/{y}.png", "no host"),
        ("https://crew:secret@maps.example/{z}/{x}/{y}.png", "no host"),
        ("https://maps.example:84430/{z}/{x}/{y}.png", "port 84430: at most 65535"),
        ("https://maps.example;script-src/{z}/{x}/{y}.png", "no host"),
        ("https://maps.example *; /{z}/{x}/{y}.png", "no spaces"),
    ],
)
def test_invalid_map_source_is_refused_with_its_key(tiles: str, stated: str) -> None:
    with pytest.raises(ConfigError) as refused:
        configured(tiles=tiles)
    assert str(refused.value).startswith("my.yaml: line 6: map.tiles = ")
    assert stated in str(refused.value)


def test_line_ends_in_a_map_source_are_refused_when_read() -> None:
    with pytest.raises(ConfigError, match=r"line 6: column 10: character U\+000D is not allowed"):
        configured(tiles="https://maps.example/{z}/{x}/{y}.png\r\nX: y")


@pytest.mark.parametrize(
    ("settings", "stated"),
    [
        ({}, "line 5: map.tiles: is required, and missing"),
        ({"tiles": 7}, "map.tiles = 7"),
        ({"tiles": ADDRESS, "zoom_max": 23}, "map.zoom_max = 23"),
        ({"tiles": ADDRESS, "zoom_max": 0}, "map.zoom_max = 0"),
        ({"tiles": ADDRESS, "attribution": "a" * 201}, "map.attribution"),
        ({"tiles": ADDRESS, "zoom": 3}, "map.zoom = 3"),
    ],
)
def test_the_rest_of_the_section_is_checked_too(settings: dict[str, Any], stated: str) -> None:
    with pytest.raises(ConfigError, match=r"my\.yaml: .*") as refused:
        configured(**settings)
    assert stated in str(refused.value)


def test_map_file_reports_zooms_and_attribution_from_north(tmp_path: Path) -> None:
    reported = {"format": "jpg", "attribution": '<a href="https://x">&copy; Crew</a>'}
    path = mbtiles(
        tmp_path / "field.mbtiles", reported, {(3, 1, 0): b"south", (3, 1, 7): b"north", (5, 2, 2): b"t"}
    )
    path.chmod(0o444)
    ground = open_map(MapSettings(tiles=str(path)))
    assert ground is not None
    assert ground.file is not None
    assert (ground.attribution, ground.zoom_min, ground.zoom_max) == ("© Crew", 3, 5)
    assert ground.origin is None
    assert ground.tiles.startswith("/api/v1/map/{z}/{x}/{y}?v=")
    assert ground.file.media_type == "image/jpeg"
    assert ground.file.tile(3, 1, 0) == b"north"
    assert ground.file.tile(3, 1, 7) == b"south"
    ours = open_map(MapSettings(tiles=str(path), attribution="Ours", zoom_max=4))
    assert ours is not None
    assert (ours.attribution, ours.zoom_max) == ("Ours", 4)
    with pytest.raises(ConfigError, match=r"map\.zoom_max = 2: .* begins with zoom 3"):
        open_map(MapSettings(tiles=str(path), zoom_max=2))


def test_missing_tile_and_impossible_tile_differ(tmp_path: Path) -> None:
    file = TileFile(mbtiles(tmp_path / "a.mbtiles", {"format": "png"}, {(3, 1, 0): b"a", (3, 2, 0): "text"}))
    for place in ((3, 0, 0), (3, 2, 7), (22, 0, 0)):
        with pytest.raises(UnknownError, match=r"a\.mbtiles has no tile"):
            file.tile(*place)
    for place, field in (
        *(((-1, 0, 0), "z"), ((23, 0, 0), "z"), ((10**30, 0, 0), "z")),
        *(((3, 8, 0), "x"), ((3, -1, 0), "x"), ((3, 0, 8), "y"), ((3, 0, -(10**30)), "y")),
    ):
        with pytest.raises(InvalidError) as refused:
            file.tile(*place)
        assert refused.value.field == field


def test_oversized_image_is_not_read(tmp_path: Path) -> None:
    pictures = {(3, 1, 0): b"a" * TILE_MOST_BYTES, (3, 2, 0): b"a" * (TILE_MOST_BYTES + 1)}
    file = TileFile(mbtiles(tmp_path / "a.mbtiles", {"format": "png"}, pictures))
    assert len(file.tile(3, 1, 7)) == TILE_MOST_BYTES
    with pytest.raises(UnknownError, match=r"tile 3/2/7 has 1048577 bytes: at most 1048576"):
        file.tile(3, 2, 7)


def test_replaced_map_file_has_new_addresses(tmp_path: Path) -> None:
    def addresses() -> str:
        ground = open_map(MapSettings(tiles=str(path)))
        assert ground is not None
        return ground.tiles

    path = mbtiles(tmp_path / "a.mbtiles", {"format": "png"}, {(3, 1, 0): b"a"})
    before = addresses()
    assert addresses() == before
    os.utime(path, ns=(1, path.stat().st_mtime_ns + 1))
    assert addresses() != before


def test_missing_map_does_not_prevent_flight(tmp_path: Path) -> None:
    section = yaml.safe_dump({"map": {"tiles": str(tmp_path / "gone.mbtiles")}})
    problems = map_problems(parse(SMALLEST + section, "my.yaml"))
    assert problems == [f"no map: map.tiles: {tmp_path}/gone.mbtiles: there is no such file"]


def test_unusable_map_file_is_refused_at_the_start(tmp_path: Path) -> None:
    one = {(3, 1, 0): b"a"}
    (tmp_path / "text.mbtiles").write_text("not a database, but as long as the beginning of one " * 9)
    (tmp_path / "folder.mbtiles").mkdir()
    sqlite3.connect(tmp_path / "empty.mbtiles").close()
    mbtiles(tmp_path / "vector.mbtiles", {"format": "pbf"}, one)
    mbtiles(tmp_path / "unknown.mbtiles", {}, one)
    mbtiles(tmp_path / "bare.mbtiles", {"format": "png"}, {})
    mbtiles(tmp_path / "zoom.mbtiles", {"format": "png", "minzoom": "low"}, one)
    for name, low, high in (("below", -5, -1), ("turned", 9, 3), ("deep", 25, 26)):
        mbtiles(tmp_path / f"{name}.mbtiles", {"format": "png", "minzoom": low, "maxzoom": high}, one)
    for name, stated in {
        "none": "there is no such file",
        "folder": "not an MBTiles file",
        "n" * 300: "File name too long",
        "text": "not an MBTiles file",
        "empty": "not an MBTiles file",
        "vector": r"vector tiles \(format pbf\)",
        "unknown": "format unknown",
        "bare": "there is no tile in it",
        "zoom": "not an MBTiles file",
        "below": "minzoom = -5 and maxzoom = -1 in its metadata: from 0 to 22",
        "turned": "minzoom = 9 and maxzoom = 3 in its metadata",
        "deep": "minzoom = 25 and maxzoom = 26 in its metadata",
    }.items():
        with pytest.raises(ConfigError, match=rf"^map\.tiles: .*{name}\.mbtiles: .*{stated}"):
            open_map(MapSettings(tiles=str(tmp_path / f"{name}.mbtiles")))


def test_replay_has_the_recorded_map_or_gives_a_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = mbtiles(tmp_path / "field.mbtiles", {"format": "png"}, {(3, 1, 0): b"a"})
    kept = parse(SMALLEST + yaml.safe_dump({"map": {"tiles": str(path)}}), "my.yaml").model_dump(mode="json")
    ground = recorded_map(kept)
    assert ground is not None
    assert ground.file is not None
    assert recorded_map({}) is None  # of a version that had none
    assert recorded_map({"map": None}) is None
    assert capsys.readouterr().err == ""
    path.unlink()
    assert recorded_map(kept) is None
    assert "without its map: map.tiles: " in capsys.readouterr().err
    assert recorded_map({"map": {"tiles": "gopher://hole"}}) is None
    assert "without its map: map: tiles = " in capsys.readouterr().err
