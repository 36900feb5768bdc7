"""A drawn show of eight vehicles, written into a folder of shows, and checked as `gcs show check` does."""

from dataclasses import asdict, replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from gcs.shows import parse
from gcs.shows.drawn import LightPrograms
from gcs.shows.formats import read_drawing, write_drawing
from gcs.shows.importing import show_text
from gcs.simulation.drawn_traffic import ORIGIN
from gcs.simulation.rehearsal import rehearse
from gcs.simulation.verdict import judge
from tests.support.drawn_shows import drawn_show

COUNT, SPACING_M = 8, 6.0
NAME, DRAWING = "drawn", "rings.skyc"

FRAME: Final = {
    "latitude_deg": ORIGIN.latitude_deg,
    "longitude_deg": ORIGIN.longitude_deg,
    "altitude_amsl_m": ORIGIN.altitude_amsl_m,
    "heading_deg": ORIGIN.heading_deg,
}


def write_show(folder: Path, lights: LightPrograms | None = None) -> None:
    """Write a show file, and its drawing beside it, with other lights if they are given."""
    path, made = folder / DRAWING, drawn_show(COUNT, 30.0, SPACING_M, ("rings",))
    write_drawing(made if lights is None else replace(made, lights=lights), path)
    drawing, data = read_drawing(path)
    (folder / f"{NAME}.yaml").write_text(show_text(drawing, path.name, sha256(data).hexdigest()))


@cache
def checked(path: Path, drawing: str) -> tuple[str, dict[str, Any]]:
    """The show with these keys of its drawing, and what `gcs show check --json --model` prints for it."""
    raw = yaml.safe_load(path.read_text())
    raw["drawing"] |= {"late": "catch-up", "spares": None, "yaw": "plan"} | yaml.safe_load(drawing)
    text = yaml.safe_dump(raw, sort_keys=False)
    loaded = parse(text, str(path))
    verdict = judge(rehearse(loaded))
    return text, asdict(verdict) | {"model": loaded.show.model_dump(mode="json")}


def on_pads(folder: Path) -> dict[str, Any]:
    """Settings of a fake fleet on the show's pads."""
    show = parse((folder / f"{NAME}.yaml").read_text(), str(folder / f"{NAME}.yaml")).show
    assert show.fleet.pads.columns == 3
    corner_m = show.pads_m[0, :2]
    c, s = np.cos(np.radians(ORIGIN.heading_deg)), np.sin(np.radians(ORIGIN.heading_deg))
    north_m, east_m = c * corner_m[0] - s * corner_m[1], s * corner_m[0] + c * corner_m[1]
    return {
        "spacing_m": show.fleet.pads.spacing_m,
        "grid_columns": show.fleet.pads.columns,
        "grid_heading_deg": ORIGIN.heading_deg,
        "grid_at_m": (float(north_m), float(east_m)),
    }
