"""Writes the show file for a drawn show: what of it is flown, from which pads, within which fence."""

from collections.abc import Iterator
from itertools import pairwise
from math import ceil
from typing import Final

import numpy as np

from gcs.model.errors import ConfigError
from gcs.model.frames import ShowFrame
from gcs.model.state import Array
from gcs.shows.drawn import DrawnShow
from gcs.shows.format import MAX_CUES

HEIGHT_MIN_M: Final = 3.0
"""Of the written fence. Lower parts of a drawing are take-off and landing, which are the station's own."""

LOW_M: Final = 10.0
"""Vehicles that end lower than this have no room to sort themselves before they land."""

FENCE_MARGIN_M: Final = 10.0
PAD_SPACING_MIN_M: Final = 3.0
NAME_MAX: Final = 60
_STEP_S: Final = 0.25


def show_text(
    drawing: DrawnShow,
    source: str,
    sha256: str,
    *,
    origin: ShowFrame | None = None,
    endurance_s: float = 900.0,
) -> str:
    """Return the show file for a drawing.

    Args:
        drawing: what was imported.
        source: name of its file, which lies beside the show file.
        sha256: of the bytes of that file.
        origin: replaces the drawing's own.
        endurance_s: of a vehicle in the air, from full to empty.

    Raises: ConfigError when no origin is known, or all vehicles are never in the air together.
    """
    place = origin or drawing.origin
    if place is None:
        raise ConfigError(f"{source}: the file names no place on Earth: give the show's origin")
    times_s = _cut(drawing)
    columns, spacing_m, (x_m, y_m) = pads_of(drawing.home_m)
    least_m, most_m = drawing.trajectories.hull_m()
    far_m = np.abs(np.concatenate([[least_m, most_m], drawing.home_m])[:, :2]).max(axis=0)
    height_max_m = ceil(-float(least_m[2]) + FENCE_MARGIN_M)
    distance_max_m = ceil(float(np.hypot(*far_m)) + FENCE_MARGIN_M)
    fence = f"height_min_m: {HEIGHT_MIN_M:g}, height_max_m: {height_max_m}, distance_max_m: {distance_max_m}"
    numbers = {
        "latitude_deg": place.latitude_deg,
        "longitude_deg": place.longitude_deg,
        "altitude_amsl_m": place.altitude_amsl_m,
        "heading_deg": place.heading_deg,
    }
    lands = ", lands: nearest" if _ends_over_others(drawing, times_s[0][0], times_s[-1][0]) else ""
    lines = [
        f"# Imported from {source}: {len(drawing)} vehicles.",
        f"about: {_quoted(drawing.title or f'A drawn show, {source}')}",
        "kind: trajectories",
        f"drawing: {{source: {source}, sha256: {sha256}{lands}}}",
        "",
        f"origin: {{{', '.join(f'{key}: {value:.10g}' for key, value in numbers.items())}}}",
        "fleet:",
        f"  vehicles: {len(drawing)}",
        f"  pads: {{columns: {columns}, spacing_m: {spacing_m:g}, x_m: {x_m:g}, y_m: {y_m:g}}}",
        f"  endurance_s: {endurance_s:g}",
        f"fence: {{{fence}}}",
        "",
        f"duration_s: {times_s[-1][0] - times_s[0][0]:.3f}",
        "timeline:",
        *_cues(times_s),
    ]
    return "\n".join(lines) + "\n"


def with_take_off(text: bytes, height_m: float, stagger_s: float) -> bytes:
    """Return a show file of `show_text` with a station's own take-off: a drawing has none to be flown."""
    own = f"\nfleet:\n  takeoff_height_m: {height_m:g}\n  takeoff_stagger_s: {stagger_s:g}\n"
    return text.replace(b"\nfleet:\n", own.encode(), 1)


def _cut(drawing: DrawnShow) -> list[tuple[float, str]]:
    """Return times of the drawing with the name of what begins then; at the last one it ends."""
    from_s, to_s = flown_s(drawing)
    names = [(round(cue.at_s, 3), cue.name) for cue in drawing.cues]
    before = [name for at_s, name in names if at_s <= from_s]
    inside: dict[float, str] = {}
    for at_s, name in names:
        if from_s < at_s < to_s:
            inside.setdefault(at_s, name)
    cut = [(from_s, before[-1] if before else "drawn"), *inside.items()][: MAX_CUES - 1]
    return [*cut, (to_s, "")]


def _cues(times_s: list[tuple[float, str]]) -> Iterator[str]:
    used: set[str] = set()
    for (from_s, written), (to_s, _) in pairwise(times_s):
        name, count = written.strip()[:NAME_MAX] or "drawn", 1
        while name in used:
            count += 1
            name = f"{written.strip()[: NAME_MAX - 5]} {count}"
        used.add(name)
        yield f"  - cue: {_quoted(name)}"
        yield f"    at_s: {from_s - times_s[0][0]:.3f}"
        yield f"    trajectories: {{from_s: {from_s:.3f}, to_s: {to_s:.3f}}}"


def flown_s(drawing: DrawnShow) -> tuple[float, float]:
    """Return from when to when all vehicles are at `HEIGHT_MIN_M` or higher, the longest such time.

    What the file names as the show, between take-off and landing, narrows it. Raises: ConfigError for none.
    """
    begin_s, end_s = drawing.show_s or (0.0, drawing.duration_s)
    times_s = np.append(
        np.arange(begin_s, min(end_s, drawing.duration_s), _STEP_S), min(end_s, drawing.duration_s)
    )
    heights_m = np.array(
        [-drawing.trajectories.at(time_s).position_m[:, 2].max() for time_s in times_s.tolist()]
    )
    flown = np.flatnonzero(heights_m >= HEIGHT_MIN_M)
    runs = np.split(flown, np.flatnonzero(np.diff(flown) > 1) + 1)
    longest = max(runs, key=len)
    if len(longest) < 2:
        raise ConfigError(f"the drawing has no time at which all vehicles are {HEIGHT_MIN_M:g} m or higher")
    return round(float(times_s[longest[0]]), 3), round(float(times_s[longest[-1]]), 3)


def _ends_over_others(drawing: DrawnShow, from_s: float, to_s: float) -> bool:
    """Whether a vehicle ends low, over another home than the one over which it begins."""
    end_m = drawing.trajectories.at(to_s).position_m
    low = -end_m[:, 2] < LOW_M
    if not low.any():
        return False
    begin, end = (
        np.linalg.norm(place_m[:, None, :2] - drawing.home_m[None, :, :2], axis=2).argmin(axis=1)
        for place_m in (drawing.trajectories.at(from_s).position_m, end_m)
    )
    return bool((begin != end)[low].any())


def pads_of(home_m: Array) -> tuple[int, float, tuple[float, float]]:
    """Return columns, spacing in m and middle (x, y) in m of the start pattern for the drawing's homes.

    Homes that are a grid keep their columns; every other pattern becomes a square one. The spacing is the
    least distance of two homes, and at least `PAD_SPACING_MIN_M`.
    """
    places_m = np.round(home_m[:, :2], 1)
    middle_m = (home_m[:, :2].min(axis=0) + home_m[:, :2].max(axis=0)) / 2.0
    apart_m = np.linalg.norm(home_m[:, None, :2] - home_m[None, :, :2], axis=2)
    np.fill_diagonal(apart_m, np.inf)
    least_m = float(apart_m.min(initial=np.inf))
    spacing_m = max(round(least_m, 2), PAD_SPACING_MIN_M) if np.isfinite(least_m) else PAD_SPACING_MIN_M
    rows, columns = (len(np.unique(places_m[:, axis])) for axis in (0, 1))
    if (rows - 1) * columns >= len(home_m) or rows * columns < len(home_m):
        columns = ceil(len(home_m) ** 0.5)
    return columns, spacing_m, (round(float(middle_m[0]), 2), round(float(middle_m[1]), 2))


def _quoted(text: str) -> str:
    """Return a text as a YAML scalar in double quotes."""
    plain = "".join(sign if sign.isprintable() else " " for sign in text)
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'
