"""What the service tells the console of the map below the show: the configuration's section `map`."""

import re
from pathlib import Path
from typing import Annotated, Final

from pydantic import Field, field_validator

from gcs.model.settings import Settings

ZOOM_MAX: Final = 22
"""A tile of this zoom is 10 m wide, and no public map has more."""

HOST: Final = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?(:[0-9]{1,5})?")

PORT_MAX: Final = 65535

NEITHER: Final = (
    "an http or https address with {z}, {x} and {y}, such as https://maps.example/{z}/{x}/{y}.png, or the"
    " path of an .mbtiles file"
)


def is_address(tiles: str) -> bool:
    """Whether `tiles` names a server, not a file."""
    return "://" in tiles


class MapSettings(Settings):
    """The map below the show."""

    tiles: Annotated[str, Field(max_length=1000)]
    """Path of an `.mbtiles` file, or a server's address with `{z}`, `{x}` and `{y}`."""
    attribution: Annotated[str, Field(max_length=200)] = ""
    """Shown in the corner of the map; empty: that of the file."""
    zoom_max: Annotated[int, Field(ge=1, le=ZOOM_MAX)] = 19
    """Greatest zoom that is requested."""

    @field_validator("tiles")
    @classmethod
    def _check_tiles(cls, tiles: str) -> str:
        if not is_address(tiles):
            if Path(tiles).suffix.lower() != ".mbtiles":
                raise ValueError(NEITHER)
            return tiles
        if re.fullmatch(r"[\x21-\x7e]+", tiles) is None:
            raise ValueError("an address has no spaces, and no letters but English ones")
        scheme, place = tiles.split("://", 1)
        host = re.split(r"[/?#]", place, maxsplit=1)[0]
        if scheme.lower() not in {"http", "https"}:
            raise ValueError(f"{scheme}:// cannot request a tile: {NEITHER}")
        if HOST.fullmatch(host) is None:
            raise ValueError(f"{host or 'nothing'} is no host: one server by its name, without a password")
        port = host.partition(":")[2]
        if port and int(port) > PORT_MAX:
            raise ValueError(f"port {port}: at most {PORT_MAX}")
        names = re.findall(r"\{([^}]*)\}", tiles)
        missing = [name for name in ("z", "x", "y") if name not in names]
        if missing:
            raise ValueError(f"{{{missing[0]}}} is missing: {NEITHER}")
        unknown = set(names) - {"z", "x", "y"}
        if unknown:
            raise ValueError(f"{{{min(unknown)}}} is not filled in; {{z}}, {{x}} and {{y}} are")
        return tiles
