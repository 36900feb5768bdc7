"""The picture of the ground: tiles of a server that the page asks itself, or of a file that we serve.

Tiles are web mercator's, numbered by zoom, column and row from the north-west, as everybody's addresses have
them. A file is an MBTiles file (specification 1.3): SQLite, rows from the south.
"""

import html
import re
import sqlite3
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Final
from urllib.parse import urlsplit

from gcs.errors import ConfigError, InvalidError, UnknownError
from gcs.map_settings import ZOOM_MAX, MapSettings, is_address

SERVED: Final = "/api/v1/map/{z}/{x}/{y}"
"""Where a page finds the tiles of our own file."""

MEDIA: Final = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
"""By what an MBTiles file calls its format."""


class TileFile:
    """An MBTiles file of pictures, open for reading. May be asked from several threads."""

    def __init__(self, path: Path) -> None:
        """Raises: ConfigError that names the file and what is wrong with it."""
        self._path = path
        self._turn = Lock()
        if not path.is_file():
            raise ConfigError(f"map.tiles: {path}: there is no such file")
        try:
            # nobody writes to it: so it can be read from a folder that cannot be written
            address = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
            self._file = sqlite3.connect(address, uri=True, check_same_thread=False)
            told = {str(name): str(value) for name, value in self._read("SELECT name, value FROM metadata")}
            if not self._read("SELECT zoom_level, tile_column, tile_row, tile_data FROM tiles LIMIT 1"):
                raise ConfigError(f"map.tiles: {path}: there is no tile in it")
            self.zoom_min = self._zoom(told.get("minzoom"), "SELECT min(zoom_level) FROM tiles")
            self.zoom_max = self._zoom(told.get("maxzoom"), "SELECT max(zoom_level) FROM tiles")
        except (sqlite3.Error, ValueError) as error:
            raise ConfigError(f"map.tiles: {path}: not an MBTiles file: {error}") from None
        kind = told.get("format", "").lower()
        if kind not in MEDIA:
            problem = "vector tiles (format pbf)" if kind == "pbf" else f"tiles of format {kind or 'unknown'}"
            raise ConfigError(f"map.tiles: {path}: {problem} cannot be drawn: png, jpg or webp can")
        self.media_type = MEDIA[kind]
        self.attribution = html.unescape(re.sub(r"<[^>]*>", "", told.get("attribution", ""))).strip()[:200]

    def _read(self, sql: str, *values: int) -> list[tuple[object, ...]]:
        with self._turn:
            return self._file.execute(sql, values).fetchall()

    def _zoom(self, told: str | None, sql: str) -> int:
        """What the file says, or else has. Raises: ValueError for no number."""
        return int(str(self._read(sql)[0][0]) if told is None else told)

    def tile(self, zoom: int, column: int, row: int) -> bytes:
        """A picture. Raises: InvalidError for numbers that no tile has, UnknownError where there is none."""
        if not 0 <= zoom <= ZOOM_MAX:
            raise InvalidError("z", zoom, f"from 0 to {ZOOM_MAX}")
        for name, value in (("x", column), ("y", row)):
            if not 0 <= value < 1 << zoom:
                raise InvalidError(name, value, f"from 0 to {(1 << zoom) - 1} at zoom {zoom}")
        sql = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        try:
            found = self._read(sql, zoom, column, (1 << zoom) - 1 - row)
        except sqlite3.Error as error:
            raise UnknownError(f"{self._path.name} cannot be read: {error}") from None
        if not found or not isinstance(found[0][0], bytes):
            raise UnknownError(f"{self._path.name} has no tile {zoom}/{column}/{row}")
        return found[0][0]

    def close(self) -> None:
        """Nothing can be read afterwards."""
        self._file.close()


@dataclass(frozen=True, slots=True)
class GroundMap:
    """What the page is told of the map."""

    tiles: str  # address, with {z}, {x} and {y}
    attribution: str
    zoom_min: int
    zoom_max: int
    file: TileFile | None = None  # None: the page asks somebody else

    @property
    def origin(self) -> str | None:
        """Whom the page asks; None: us."""
        if self.file is not None:
            return None
        parts = urlsplit(self.tiles)
        return f"{parts.scheme}://{parts.netloc}"


def open_map(settings: MapSettings | None) -> GroundMap | None:
    """The map that is configured. Raises: ConfigError when its file cannot be used."""
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
    return GroundMap(SERVED, settings.attribution or file.attribution, file.zoom_min, zoom_max, file)
