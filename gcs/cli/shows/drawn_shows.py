"""`gcs show import` and `gcs show sample`: drawn shows from the files of other programs, and their previews.

They load no simulation: the API runs both for requests.
"""

import argparse
import json
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from hashlib import sha256
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import ValidationError

from gcs.cli.output import answer, output_file
from gcs.config import schema
from gcs.config.setting_errors import explained
from gcs.model.errors import ConfigError, InvalidError, ShowError
from gcs.model.frames import ShowFrame
from gcs.shows import find, load, parse
from gcs.shows.formats import read_drawing
from gcs.shows.importing import YAW, show_file
from gcs.shows.service_rules import ServiceRules

NAME_MAX: Final = 60
"""Characters of a drawing's name, without its suffix."""


def import_show(arguments: argparse.Namespace) -> int:
    """Write a show file for a drawing, and a copy of the drawing beside it.

    Returns: 0. Raises: ConfigError for a file that is no drawing, or a show that exists already.
    """
    given, target = Path(arguments.file), output_file(arguments.output, (".yaml",))
    drawing, data = read_drawing(given)
    if drawing.origin is None:
        drawing = replace(drawing, origin=_origin_else(arguments))
    rules = rules_of(arguments) or ServiceRules()
    beside = target.with_name(_safe(target.stem) + given.suffix.lower())
    is_source = beside.exists() and beside.samefile(given)
    for path in (target, *(() if is_source else (beside,))):
        if path.exists():
            raise ConfigError(f"{path}: there is such a file already: remove it, or choose another name")
    digest = sha256(data).hexdigest()
    written = show_file(
        drawing,
        beside.name,
        digest,
        origin=None if arguments.origin is None else frame_at(arguments.origin, "--origin"),
        endurance_s=arguments.endurance,
        rules=rules,
    )
    try:
        if not is_source:
            beside.write_bytes(data)
        parse(written.text, str(target), (drawing, digest))
        target.write_text(written.text, encoding="utf-8")
    except (OSError, ShowError) as error:
        if not is_source:
            with suppress(OSError):
                beside.unlink(missing_ok=True)
        if isinstance(error, ShowError):
            raise
        raise ConfigError(f"{target}: {error.strerror}") from None
    document = {
        "show": str(target),
        "drawing": str(beside),
        "vehicles": len(drawing),
        "duration_s": round(drawing.duration_s, 3),
        "flown_s": written.flown_s,
        "claims": asdict(drawing.claims),
        "notes": written.notes,
    }
    flown = "flown from {:.1f} to {:.1f} s".format(*written.flown_s)
    words = f"{target}: {len(drawing)} vehicles, {drawing.duration_s:.1f} s, {flown}; drawing {beside}"
    lines = [words, *(f"not used: {note}" for note in written.notes), *([YAW] if drawing.yaw.turns else [])]
    answer(arguments, document, "\n".join(lines))
    return 0


def rules_of(arguments: argparse.Namespace) -> ServiceRules | None:
    """Return the rules of the service that is to fly the show, if it is known. Raises: ConfigError."""
    if arguments.config is not None:
        config = schema.load(schema.find(arguments.config))
        return ServiceRules.of(config.control, config.operation)
    try:
        return ServiceRules.model_validate_json(arguments.rules) if arguments.rules else None
    except ValidationError as error:
        raise explained(error, "--rules", ServiceRules, None) from None


def _origin_else(arguments: argparse.Namespace) -> ShowFrame | None:
    """Return the origin for a drawing that names none, if it is known. Raises: ConfigError."""
    if arguments.origin_else is not None:
        return frame_at(arguments.origin_else, "--origin-else")
    return None if arguments.config is None else schema.load(schema.find(arguments.config)).frame


def _safe(stem: str) -> str:
    """Return a name for the drawing that a show file can have: letters, digits, and _ . - after the first."""
    return re.sub(r"[^A-Za-z0-9_.-]", "-", stem)[:NAME_MAX].lstrip("_.-") or "drawing"


SAMPLES_MAX: Final = 200_000
"""Positions of all vehicles at all times in one answer."""


def sample_show(arguments: argparse.Namespace) -> int:
    """Print where the vehicles of a drawn show are, and their lights, at regular times of the show's clock.

    Returns: 0. Raises: ConfigError for a bad show, or one without a drawing.
    """
    loaded = load(find(arguments.file))
    drawing, timeline = loaded.drawing, loaded.timeline
    if drawing is None:
        raise ConfigError(f"{loaded.file}: the show has no drawing")
    from_s, rate_hz = arguments.from_s, arguments.rate
    to_s = min(timeline.duration_s if arguments.to_s is None else arguments.to_s, timeline.duration_s)
    if not (0.0 <= from_s <= to_s and 0.0 < rate_hz <= RATE_MAX_HZ):
        allowed = f"from 0 to {timeline.duration_s:g} s, at most {RATE_MAX_HZ:g} Hz, are needed"
        raise ConfigError(f"{loaded.file}: {from_s:g} to {to_s:g} s at {rate_hz:g} Hz: {allowed}")
    most = max(SAMPLES_MAX // len(drawing), 2)
    rate_hz = min(rate_hz, (most - 1) / max(to_s - from_s, 1e-3))
    positions_m: list[list[float]] = []
    colours: list[str] = []
    for time_s in (from_s + np.arange(int((to_s - from_s) * rate_hz + 1e-9) + 1) / rate_hz).tolist():
        drawn_s = timeline.drawn_s(time_s)
        if drawn_s is None:
            positions_m.append([])
            colours.append("")
            continue
        place_m = drawing.trajectories.at(drawn_s).position_m * (1.0, 1.0, -1.0)
        positions_m.append((np.round(place_m, 2) + 0.0).ravel().tolist())
        colours.append(drawing.lights.colours_at(drawn_s).tobytes().hex())
    document = {
        "show": loaded.name,
        "vehicles": list(drawing.vehicles),
        "duration_s": timeline.duration_s,
        "from_s": from_s,
        "rate_hz": rate_hz,
        "positions_m": positions_m,
        "colours": colours,
        "cues": [{"cue": one.cue.cue, "at_s": one.at_s} for one in timeline.played],
    }
    json.dump(document, sys.stdout, separators=(",", ":"))
    return 0


RATE_MAX_HZ: Final = 50.0


def frame_at(place: Sequence[float], option: str) -> ShowFrame:
    """Return the frame at latitude, longitude, altitude and heading. Raises: ConfigError."""
    try:
        return ShowFrame(*place)
    except InvalidError as error:
        raise ConfigError(f"{option}: {error}") from None
