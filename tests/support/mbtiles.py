"""Map files, made as tests need them."""

import sqlite3
from pathlib import Path
from typing import Any


def mbtiles(path: Path, metadata: dict[str, Any], tiles: dict[tuple[int, int, int], Any]) -> Path:
    """A file; its tiles by zoom, column and row from the south, as the format has them."""
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        file.execute("CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)")
        file.executemany("INSERT INTO metadata VALUES (?, ?)", metadata.items())
        file.executemany(
            "INSERT INTO tiles VALUES (?, ?, ?, ?)", [(*place, data) for place, data in tiles.items()]
        )
    file.close()
    return path
