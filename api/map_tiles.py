"""Map tiles: of a tile server that the page requests itself, or of a file that this service serves.

Tiles are in web mercator, numbered by zoom, column and row from the north-west, as is usual in tile URLs.
A file is an MBTiles file (specification 1.3): SQLite, rows from the south.
"""

import asyncio
import html
import re
import sqlite3
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final
from urllib.parse import urlsplit

from pydantic import ConfigDict, Field

from gcs.model.errors import ConfigError, InvalidError, UnknownError
from gcs.service.map_settings import ZOOM_MAX, MapSettings, is_address

SERVED: Final = "/api/v1/map/{z}/{x}/{y}"
"""URL template of the tiles of this service's own file."""

TILE_MOST_BYTES: Final = 1 << 20
"""Largest tile that is read; usual ones have some 10 kB."""

ATTRIBUTION_MAX: Final = 2000
"""Characters, with the marks that are left out."""

MEDIA: Final = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
"""Media type by the `format` of an MBTiles file."""


class TileFile:
    """An MBTiles file of raster tiles, open for reading. Not for use by several threads at once."""

    def __init__(self, path: Path) -> None:
        """Raises: ConfigError that names the file and its problem."""
        self._path = path
        self._turn = asyncio.Semaphore()
        try:
            self.version = path.stat().st_mtime_ns
            # immutable: the file can then be read in a folder that is not writable
            address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
            self._file = sqlite3.connect(address, uri=True, check_same_thread=False)
            self.close = self._file.close
            reported = {
                str(name): str(value) for name, value in self._read("SELECT name, value FROM metadata")
            }
            columns = "zoom_level, tile_column, tile_row, length(tile_data)"
            if not self._read(f"SELECT {columns} FROM tiles LIMIT 1"):  # noqa: S608 - constant column names
                raise ConfigError(f"map.tiles: {path}: there is no tile in it")
            self.zoom_min = self._zoom(reported.get("minzoom"), "SELECT min(zoom_level) FROM tiles")
            zoom_max = self._zoom(reported.get("maxzoom"), "SELECT max(zoom_level) FROM tiles")
        except FileNotFoundError:
            raise ConfigError(f"map.tiles: {path}: there is no such file") from None
        except OSError as error:
            raise ConfigError(f"map.tiles: {path}: {error.strerror}") from None
        except (sqlite3.Error, ValueError) as error:
            raise ConfigError(f"map.tiles: {path}: not an MBTiles file: {error}") from None
        if not 0 <= self.zoom_min <= min(zoom_max, ZOOM_MAX):
            zooms = f"minzoom = {self.zoom_min} and maxzoom = {zoom_max} in its metadata"
            raise ConfigError(f"map.tiles: {path}: {zooms}: from 0 to {ZOOM_MAX}, in that order")
        self.zoom_max = min(zoom_max, ZOOM_MAX)
        kind = reported.get("format", "").lower()
        if kind not in MEDIA:
            problem = "vector tiles (format pbf)" if kind == "pbf" else f"tiles of format {kind or 'unknown'}"
            raise ConfigError(f"map.tiles: {path}: {problem} cannot be drawn: png, jpg or webp can")
        self.media_type = MEDIA[kind]
        attribution = reported.get("attribution", "")[:ATTRIBUTION_MAX]  # the search is quadratic
        plain = html.unescape(re.sub(r"<[^>]*>", "", attribution))
        self.attribution = plain.strip()[:200]

    def _read(self, sql: str, *values: int) -> list[tuple[object, ...]]:
        return self._file.execute(sql, values).fetchall()

    def _zoom(self, reported: str | None, sql: str) -> int:
        """Zoom of the file's metadata, else of its tiles. Raises: ValueError when it is not a number."""
        return int(str(self._read(sql)[0][0]) if reported is None else reported)

    def tile(self, zoom: int, column: int, row: int) -> bytes:
        """Return the bytes of one tile; `row` counts from the north.

        Raises: InvalidError for no tile of web mercator, UnknownError for one that is absent, sqlite3.Error.
        """
        if not 0 <= zoom <= ZOOM_MAX:
            raise InvalidError("z", zoom, f"from 0 to {ZOOM_MAX}")
        for name, value in (("x", column), ("y", row)):
            if not 0 <= value < 1 << zoom:
                raise InvalidError(name, value, f"from 0 to {(1 << zoom) - 1} at zoom {zoom}")
        sql = (
            "SELECT length(tile_data), CASE WHEN length(tile_data) <= ? THEN tile_data END FROM tiles"
            " WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        )
        found = self._read(sql, TILE_MOST_BYTES, zoom, column, (1 << zoom) - 1 - row)
        length, picture = found[0] if found else (None, None)
        if isinstance(picture, bytes):
            return picture
        name = f"tile {zoom}/{column}/{row}"
        if isinstance(length, int) and length > TILE_MOST_BYTES:
            raise UnknownError(f"{self._path.name}: {name} has {length} bytes: at most {TILE_MOST_BYTES}")
        raise UnknownError(f"{self._path.name} has no {name}")

    async def read(self, zoom: int, column: int, row: int) -> bytes:
        """As `tile`, one at a time in a thread, so that a slow disk does not block the event loop."""
        async with self._turn:
            return await asyncio.to_thread(self.tile, zoom, column, row)


@dataclass(frozen=True, slots=True)
class GroundMap:
    """The map of the ground, as tiles in web mercator."""

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    tiles: Annotated[
        str,
        Field(
            description="Address of a tile: `{z}` is the zoom, `{x}` the column from the west, `{y}` the row"
            " from the north. One that begins with `/` is this service's own, and asks for the token.",
            examples=["/api/v1/map/{z}/{x}/{y}"],
        ),
    ]
    attribution: Annotated[str, Field(description="Text to show with the map.")]
    zoom_min: int
    zoom_max: int
    # None: the page requests the tiles from another server
    file: Annotated[TileFile | None, Field(exclude=True)] = None

    @property
    def origin(self) -> str | None:
        """Origin of a foreign tile server; None: this service."""
        if self.file is not None:
            return None
        parts = urlsplit(self.tiles)
        return f"{parts.scheme}://{parts.netloc}"


def open_map(settings: MapSettings | None) -> GroundMap | None:
    """Open the configured map. Raises: ConfigError when its file cannot be used."""
    if settings is None:
        return None
    if is_address(settings.tiles):
        return GroundMap(settings.tiles, settings.attribution, 0, settings.zoom_max)
    file = TileFile(Path(settings.tiles))
    zoom_max = min(settings.zoom_max, file.zoom_max, ZOOM_MAX)
    if zoom_max < file.zoom_min:
        file.close()
        raise ConfigError(
            f"map.zoom_max = {settings.zoom_max}: {settings.tiles} begins with zoom {file.zoom_min}"
        )
    tiles = f"{SERVED}?v={file.version:x}"  # browsers cache tiles, so another file needs other URLs
    return GroundMap(tiles, settings.attribution or file.attribution, file.zoom_min, zoom_max, file)
