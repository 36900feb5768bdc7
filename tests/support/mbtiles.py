"""Creates map files for tests."""

import sqlite3
from pathlib import Path
from typing import Any


def mbtiles(path: Path, metadata: dict[str, Any], tiles: dict[tuple[int, int, int], Any]) -> Path:
    """Create a file; its tiles are by zoom, column and row from the south, as in the format."""
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        file.execute("CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)")
        file.executemany("INSERT INTO metadata VALUES (?, ?)", metadata.items())
        file.executemany(
            "INSERT INTO tiles VALUES (?, ?, ?, ?)", [(*place, data) for place, data in tiles.items()]
        )
    file.close()
    return path
