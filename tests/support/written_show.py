"""A small show for four vehicles of `virtual_show`, checked as `gcs show check` does."""

from dataclasses import asdict
from functools import cache
from math import cos, radians, sin
from pathlib import Path
from typing import Any, Final

from gcs.config.schema import Config
from gcs.recording.session import Record
from gcs.shows import parse
from gcs.simulation.rehearsal import rehearse
from gcs.simulation.verdict import judge
from gcs.testing.virtual_show import HEADING_DEG, Story, T, VirtualShow, show_config
from gcs.testing.virtual_show import fly as fly_anywhere

NAME = "small"
TEXT = """
about: Four vehicles stand, walk, turn and follow a guest.
origin: {latitude_deg: 47.397742, longitude_deg: 8.545594, altitude_amsl_m: 488.0, heading_deg: 30.0}
fleet:
  vehicles: 4
  pads: {columns: 2, spacing_m: 5.0}
  endurance_s: 900.0
fence: {height_min_m: 3.0, height_max_m: 60.0, distance_max_m: 100.0}
duration_s: 42.0
timeline:
  - {cue: stand, at_s: 0, radius_m: 6, height_m: 14, target: {x_m: 3, y_m: 1}, lights: ["#ff0000", "#0000ff"]}
  - {cue: walk, at_s: 8, target: {x_m: 11, y_m: 1}, over_s: 8, lights: ["#00ff00"]}
  - {cue: turn, at_s: 18, spin: {rate_deg_s: 10}, over_s: 3}
  - {cue: guest, at_s: 26, target: live, radius_m: 7, over_s: 3}
  - cue: tower
    at_s: 34
    obstacles: {appear: [{id: tower, x_m: 50, y_m: 40, half_length_x_m: 2, half_length_y_m: 2, height_m: 20}]}
"""


SPACING_M: Final = 5.0


def on_pads(turned_deg: float = 0.0, north_m: float = 0.0, east_m: float = 0.0) -> dict[str, Any]:
    """Settings of a fake fleet on the show's pads, rotated about their centre and shifted."""
    heading_deg = HEADING_DEG + turned_deg
    c, s = cos(radians(heading_deg)), sin(radians(heading_deg))
    half_m = SPACING_M / 2.0
    return {
        "spacing_m": SPACING_M,
        "grid_heading_deg": heading_deg,
        "grid_at_m": (north_m - half_m * (c - s), east_m - half_m * (s + c)),
    }


def fly(story: Story[T], plan: Config, *, record: Record | None = None, **fleet_settings: Any) -> T:
    """As `virtual_show.fly`, with the fake fleet on the show's pads."""
    return fly_anywhere(story, plan, record=record, **{**on_pads(), **fleet_settings})


@cache
def answer(text: str) -> dict[str, Any]:
    """The answer of `gcs show check --json --model`."""
    loaded = parse(text, NAME)
    verdict = judge(rehearse(loaded))
    return asdict(verdict) | {"problems": [], "model": loaded.show.model_dump(mode="json")}


def check_once() -> None:
    """So that no copy of the process checks `TEXT` for itself."""
    answer(TEXT)


def config(folder: Path, **sections: Any) -> Config:
    """A configuration with four vehicles and a folder for shows."""
    return show_config(4, shows={"folder": folder}, **sections)


def keep(show: VirtualShow, text: str = TEXT, name: str = NAME) -> None:
    """Write the file into the folder of the service."""
    assert show.config.shows is not None
    (show.config.shows.folder / f"{name}.yaml").write_text(text)


def check(show: VirtualShow, text: str = TEXT, name: str = NAME) -> str:
    """Write the file and its check. Returns: the hash for the start."""
    keep(show, text, name)
    reported = show.service.shows.found(name, text.encode(), dict(answer(text)))
    assert reported.good or not reported.fits_service
    assert reported.hash is not None
    return reported.hash


def select(show: VirtualShow, text: str = TEXT) -> str:
    """Check and select a show."""
    show_hash = check(show, text)
    show.service.player.select(NAME, show_hash)
    return show_hash
