"""Writes the show file for a drawn show: what of it is flown, from which pads, within which fence."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from math import ceil, floor
from typing import Any, Final, NamedTuple

import numpy as np

from gcs.model.errors import ConfigError
from gcs.model.frames import ShowFrame
from gcs.model.state import Array
from gcs.shows.drawn import DrawnShow
from gcs.shows.format import MAX_CUES, ShowLimits
from gcs.shows.service_rules import ServiceRules

LOW_M: Final = 10.0
"""Vehicles that end lower than this have no room to sort themselves before they land."""

FENCE_MARGIN_M: Final = 10.0
PAD_SPACING_MIN_M: Final = 3.0
NAME_MAX: Final = 60
YAW: Final = "The drawing has yaw: it is flown with 'yaw: drawn' in 'drawing'"
CUES_NAMED: Final = 5
"""Most cues that a note names."""

HIGH_SHARE: Final = 0.9
"""A drawing lower than the station's take-off is flown from this share of its height on."""

ROUNDED_M: Final = 0.02
"""Heights in files are rounded."""

GIVE_ORIGIN: Final = (
    "give the show's origin (--origin LAT,LON,ALT,HEADING), or the configuration that has it (--config)"
)

_STEP_S: Final = 0.25


class _Part(NamedTuple):
    """What is played from a time of the drawing on, up to the next part's."""

    from_s: float
    name: str


class ShowFile(NamedTuple):
    """What an import writes, and what an operator should know of it."""

    text: str
    flown_s: tuple[float, float]  # of the drawing, from when to when
    notes: tuple[str, ...]  # what of the drawing is not flown


def show_text(*given: Any, **named: Any) -> str:
    """Return the text of `show_file`."""
    return show_file(*given, **named).text


def show_file(
    drawing: DrawnShow,
    source: str,
    sha256: str,
    *,
    origin: ShowFrame | None = None,
    endurance_s: float = 900.0,
    rules: ServiceRules | None = None,
) -> ShowFile:
    """Return the show file for a drawing.

    Args:
        drawing: what was imported.
        source: name of its file, which lies beside the show file.
        sha256: of the bytes of that file.
        origin: replaces the drawing's own.
        endurance_s: of a vehicle in the air, from full to empty.
        rules: of the service that is to fly it; None: the defaults.

    Raises: ConfigError when no origin is known, or all vehicles are never in the air together.
    """
    place, rules = origin or drawing.origin, rules or ServiceRules()
    if place is None:
        raise ConfigError(f"{source}: the file names no place on Earth: {GIVE_ORIGIN}")
    parts = _cut(drawing, rules)
    begin_s, end_s = parts[0].from_s, parts[-1].from_s
    columns, spacing_m, (x_m, y_m) = pads_of(drawing.home_m)
    least_m, most_m = drawing.trajectories.hull_m()
    far_m = np.abs(np.concatenate([[least_m, most_m], drawing.home_m])[:, :2]).max(axis=0)
    fence = rules.fenced(
        ceil(-float(least_m[2]) + FENCE_MARGIN_M), ceil(float(np.hypot(*far_m)) + FENCE_MARGIN_M)
    )
    numbers = {
        "latitude_deg": place.latitude_deg,
        "longitude_deg": place.longitude_deg,
        "altitude_amsl_m": place.altitude_amsl_m,
        "heading_deg": place.heading_deg,
    }
    exchanges = rules.exchanges_pads and _ends_over_others(drawing, begin_s, end_s)
    lands = ", lands: nearest" if exchanges else ""
    narrower = {
        key: value for key, value in rules.limits.model_dump().items() if value != getattr(ShowLimits(), key)
    }
    lines = [
        f"# Imported from {source}: {len(drawing)} vehicles.",
        *([f"# {YAW}."] if drawing.yaw.turns else []),
        f"about: {_quoted(drawing.title or f'A drawn show, {source}')}",
        "kind: trajectories",
        f"drawing: {{source: {source}, sha256: {sha256}{lands}}}",
        "",
        f"origin: {_flow(numbers)}",
        "fleet:",
        f"  vehicles: {len(drawing)}",
        f"  pads: {{columns: {columns}, spacing_m: {spacing_m:g}, x_m: {x_m:g}, y_m: {y_m:g}}}",
        f"  takeoff_height_m: {rules.takeoff_height_m:.10g}",
        f"  takeoff_stagger_s: {rules.takeoff_stagger_s:.10g}",
        f"  endurance_s: {endurance_s:g}",
        *([f"limits: {_flow(narrower)}"] if narrower else []),
        f"fence: {_flow(fence.model_dump())}",
        "",
        f"duration_s: {end_s - begin_s:.3f}",
        "timeline:",
        *_cues(parts),
    ]
    notes = [*drawing.notes, *_left_out(drawing, parts)]
    return ShowFile("\n".join(lines) + "\n", (begin_s, end_s), tuple(notes))


def _flow(numbers: Mapping[str, float]) -> str:
    """Return numbers as YAML in braces."""
    return f"{{{', '.join(f'{key}: {value:.10g}' for key, value in numbers.items())}}}"


def _left_out(drawing: DrawnShow, parts: list[_Part]) -> list[str]:
    """Return what of the drawing's cues is not among the parts, in words."""
    flown = {(part.from_s, part.name) for part in parts}
    begin_s, end_s = parts[0].from_s, parts[-1].from_s
    left = [cue for cue in drawing.cues if (max(round(cue.at_s, 3), begin_s), cue.name) not in flown]
    if not left:
        return []
    named = ", ".join(f"'{cue.name}' at {cue.at_s:g} s" for cue in left[:CUES_NAMED])
    more = f" and {len(left) - CUES_NAMED} more" if len(left) > CUES_NAMED else ""
    return [f"cues {named}{more}: cues are flown from {begin_s:g} to {end_s:g} s, one at a time"]


def _cut(drawing: DrawnShow, rules: ServiceRules) -> list[_Part]:
    """Return the parts of the drawing that are flown; the last one is where it ends."""
    from_s, to_s = flown_s(drawing, rules)
    names = [(round(cue.at_s, 3), cue.name) for cue in drawing.cues]
    before = [name for at_s, name in names if at_s <= from_s]
    inside: dict[float, str] = {}
    for at_s, name in names:
        if from_s < at_s < to_s:
            inside.setdefault(at_s, name)
    cut = [_Part(from_s, before[-1] if before else "drawn"), *(_Part(*each) for each in inside.items())]
    return [*cut[: MAX_CUES - 1], _Part(to_s, "")]


def _cues(parts: list[_Part]) -> Iterator[str]:
    used: set[str] = set()
    for (from_s, written), (to_s, _) in pairwise(parts):
        name, count = written.strip()[:NAME_MAX] or "drawn", 1
        while name in used:
            count += 1
            name = f"{written.strip()[: NAME_MAX - 5]} {count}"
        used.add(name)
        yield f"  - cue: {_quoted(name)}"
        yield f"    at_s: {from_s - parts[0].from_s:.3f}"
        yield f"    trajectories: {{from_s: {from_s:.3f}, to_s: {to_s:.3f}}}"


def flown_s(drawing: DrawnShow, rules: ServiceRules | None = None) -> tuple[float, float]:
    """Return from when to when the drawing is flown: from where the station's take-off hands over.

    It is the longest time in which all vehicles are above the fence's least height, up to where the last
    one of them has climbed to the take-off's height, and from where the first one has sunk to it. What the
    file names as the show, between take-off and landing, narrows it.

    Raises: ConfigError, with time and vehicle, when they are never so high together.
    """
    rules = rules or ServiceRules()
    begin_s, end_s = drawing.show_s or (0.0, drawing.duration_s)
    end_s = floor(min(end_s, drawing.duration_s) * 1e3 + 1e-3) / 1e3  # in the file: whole milliseconds
    if begin_s >= end_s:
        lasts = f"the drawing lasts {drawing.duration_s:g} s, and its show (meta.segments) begins"
        raise ConfigError(f"{lasts} at {begin_s:g} s: nothing of it can be flown")
    times_s = np.append(np.arange(begin_s, end_s, _STEP_S), end_s)
    heights_m = -np.stack([drawing.trajectories.at(time_s).position_m[:, 2] for time_s in times_s.tolist()])
    lowest_m, least_m = heights_m.min(axis=1), rules.height_min_m
    flown = np.flatnonzero(lowest_m >= least_m)
    longest = max(np.split(flown, np.flatnonzero(np.diff(flown) > 1) + 1), key=len)
    if len(longest):
        top_m = min(rules.takeoff_height_m, HIGH_SHARE * float(lowest_m[longest].max()))
        up = longest[lowest_m[longest] >= max(top_m - ROUNDED_M, least_m)]
        longest = longest[(longest >= up[0]) & (longest <= up[-1])]
    if len(longest) < 2:
        at = int(lowest_m.argmax())
        low = drawing.vehicles[int(heights_m[at].argmin())]
        never = "never" if lowest_m[at] < least_m else f"for less than {_STEP_S:g} s"
        raise ConfigError(
            f"all vehicles are {never} {least_m:g} m or higher together, the least height of the fence:"
            f" at {times_s[at]:.2f} s of the drawing, when they are highest, {low} is at {lowest_m[at]:.2f} m"
        )
    return ceil(float(times_s[longest[0]]) * 1e3 - 1e-3) / 1e3, round(float(times_s[longest[-1]]), 3)


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
