"""Show files for tests: the shipped ones, the broken ones, and variations of a valid one."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import yaml

from gcs.model.errors import Problem, ShowError
from gcs.shows import LoadedShow, load, parse, shipped
from gcs.shows.library import ShowLibrary

BROKEN = Path(__file__).parents[1] / "data" / "shows"

SOUND: dict[str, Any] = {
    "about": "A trial.",
    "origin": {"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_amsl_m": 488.0, "heading_deg": 0.0},
    "fleet": {"vehicles": 8, "pads": {"columns": 4, "spacing_m": 5.0}, "endurance_s": 900.0},
    "fence": {"height_min_m": 3.0, "height_max_m": 60.0, "distance_max_m": 80.0},
    "duration_s": 60.0,
}

BEGIN = {"cue": "begin", "at_s": 0, "radius_m": 8, "height_m": 20}


def text_of(*cues: dict[str, Any], **changes: Any) -> str:
    """A show with the common beginning, these cues and changed keys."""
    return yaml.safe_dump(SOUND | {"timeline": [BEGIN, *cues]} | changes, sort_keys=False)


def loaded(*cues: dict[str, Any], **changes: Any) -> LoadedShow:
    return parse(text_of(*cues, **changes), "trial.yaml")


def problems(*cues: dict[str, Any], **changes: Any) -> tuple[Problem, ...]:
    """Problems of a show file."""
    try:
        loaded(*cues, **changes)
    except ShowError as error:
        return error.problems
    return ()


FIGURES: dict[str, Any] = {
    **dict.fromkeys(("vehicles", "pairs_below_floor", "vertical_overlaps"), 0),
    **dict.fromkeys(("show_s", "assembled_s", "home_s", "floor_m", "separation_min_m"), 1.0),
    **dict.fromkeys(("speed_max_m_s", "climb_max_m_s", "sink_max_m_s", "battery_need"), 0.5),
    **dict.fromkeys(("fence_distance_margin_m", "fence_height_margin_m"), 9.0),
    "separation_min_at": "lamp",
    "columns": [],
    "cues": [],
}
"""What `gcs show check --json` prints beside its verdict."""


LIGHTHOUSE = next(path for path in shipped() if path.stem == "lighthouse")


def checked_show(library: ShowLibrary) -> str:
    """Store a show that was checked, and is good to fly. Returns: its hash."""
    text, model = LIGHTHOUSE.read_bytes(), load(LIGHTHOUSE).show
    with ThreadPoolExecutor() as thread:  # that of a browser test has a loop of its own
        thread.submit(asyncio.run, library.store("lighthouse", text)).result()
    answer = {**FIGURES, "good": True, "problems": [], "model": model.model_dump(mode="json")}
    library.found("lighthouse", text, answer)
    return model.digest
