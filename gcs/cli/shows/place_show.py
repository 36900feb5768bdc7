"""`gcs show place`: where a drawn show lies on its field, and how far the vehicles are from their pads."""

import argparse
import json
from collections.abc import Sequence
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from gcs.cli.output import answer, output_file
from gcs.cli.shows.drawn_shows import frame_at, rules_of
from gcs.config.setting_errors import explained
from gcs.config.yaml_files import read
from gcs.model.errors import ConfigError, RefusedError
from gcs.shows import find, parse
from gcs.shows import placement as placing
from gcs.shows.format import Placement


def place_show(arguments: argparse.Namespace) -> int:
    """Print a placement of a drawn show, by default its own, with the distance of each vehicle from its pad.

    With `--fit` it is the best one for the vehicles, with `-o` the show file with it is written.

    Returns: 0. Raises: ConfigError for a bad show or option, or one without a drawing.
    """
    path = find(arguments.file)
    text = read(path)
    loaded = parse(text, str(path))
    show, drawing = loaded.show, loaded.drawing
    if drawing is None or show.drawing is None:
        raise ConfigError(f"{loaded.file}: the show has no drawing")
    frame = show.origin.frame if arguments.frame is None else frame_at(arguments.frame, "--frame")
    standing = {} if arguments.vehicles is None else _vehicles(Path(arguments.vehicles))
    at_m = np.array([(np.nan, np.nan) if one is None else one for one in standing.values()]).reshape(-1, 2)
    stored = placing.in_frame(show, frame)
    place = stored if arguments.at is None else _placement(arguments.at, stored)
    if arguments.fit:
        try:
            place = placing.fitted(show, place, at_m)
        except RefusedError as error:
            raise ConfigError(f"--fit: {error}") from None
    rules = rules_of(arguments)
    fence_m = placing.fence_m(show, drawing, place, rules)
    document: dict[str, Any] = {
        "show": loaded.name,
        **placing.stand_document(show, placing.stand(show, place, at_m), standing),
        "heading_deg": round((frame.heading_deg + place.turn_deg) % 360.0, 2),
        "stored": stored.model_dump(),
        "written": show.drawing.place.model_dump(),
        "origin_changes": not placing.same_frame(show, frame),
        "fence_distance_m": fence_m,
    }
    if arguments.output is not None:
        changed = placing.placed_text(loaded.source, text, show, fence_m, place, frame, rules)
        if parse(changed, str(path)).show.drawing != show.drawing.model_copy(update={"place": place}):
            raise ConfigError(f"{loaded.file}: its drawing cannot be placed: write 'drawing' anew")
        target = output_file(arguments.output, (".yaml",))
        try:
            target.write_text(changed, encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"-o {target}: {error.strerror}") from None
        document |= {"stored": place.model_dump(), "written": place.model_dump(), "origin_changes": False}
    answer(arguments, document, _words(document))
    return 0


def _words(document: dict[str, Any]) -> str:
    where = (
        f"{document['show']}: x {document['x_m']:g} m, y {document['y_m']:g} m, turned by"
        f" {document['turn_deg']:g} deg clockwise (heading {document['heading_deg']:g} deg);"
        f" fence at {document['fence_distance_m']:g} m"
    )
    lines = [where]
    if document["rms_m"] is not None:
        lines.append(
            f"vehicles beside their pads: {document['rms_m']:g} m rms, {document['max_m']:g} m at most"
        )
    for one in document["vehicles"]:
        where = "no position" if one["x_m"] is None else "no pad is left"
        if one["pad"] is not None:
            where = f"pad {one['pad'] + 1}, {one['off_m']:g} m off"
        lines.append(f"  {one['id']}: {where}")
    return "\n".join(lines)


def _placement(at: Sequence[float], stored: Placement) -> Placement:
    """Return the placement at X, Y, TURN; what is NaN is as stored. Raises: ConfigError."""
    named = dict(zip(("x_m", "y_m", "turn_deg"), at, strict=True))
    given = {key: value for key, value in named.items() if not isnan(value)}
    try:
        return Placement(**stored.model_dump() | given)
    except ValidationError as error:
        raise explained(error, "--at", Placement, None) from None


def _vehicles(path: Path) -> dict[str, tuple[float, float] | None]:
    """Return where vehicles stand, by name, from a JSON file. Raises: ConfigError."""
    try:
        content = json.loads(path.read_bytes())
        return {
            str(name): None if at_m is None else (float(at_m[0]), float(at_m[1]))
            for name, at_m in content.items()
        }
    except (OSError, ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        needed = 'an object with the place of each vehicle is needed: {"d1": [x, y], "d2": null}'
        raise ConfigError(f"--vehicles {path}: {needed}: {error}") from None
