"""Loads a show file, names every problem, and compares the show with the service that flies it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from hashlib import sha256
from math import hypot
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from gcs.config import yaml_files as documents
from gcs.config.sections import OperationSettings
from gcs.config.setting_errors import Misfit, misfits
from gcs.config.yaml_files import Loc, Source
from gcs.control import ControlSettings
from gcs.model.errors import ConfigError, FileError, Problem, ShowError
from gcs.model.frames import ShowFrame
from gcs.shows.drawn import DrawnShow
from gcs.shows.drawn_parts import drawing_flaws
from gcs.shows.flaws import Flaw
from gcs.shows.format import Drawing, Placement, Show
from gcs.shows.formats import read_drawing
from gcs.shows.service_rules import AT_MOST
from gcs.shows.timeline import Timeline
from gcs.shows.validation import flaws


@dataclass(frozen=True, slots=True, eq=False)
class LoadedShow:
    """A show without flaws, and the lines of its parts in the file."""

    name: str  # the file's, without its suffix
    file: str
    show: Show
    timeline: Timeline
    source: Source
    drawing: DrawnShow | None = None  # of a show of kind 'trajectories'

    def problem(self, flaw: Flaw) -> Problem:
        return located(flaw, self.source, [cue.cue for cue in self.show.timeline])


def load(path: Path) -> LoadedShow:
    """Read and check a show file, and its drawing beside it.

    Raises: ShowError with everything that is wrong with it; ConfigError when it cannot be read.
    """
    return parse(documents.read(path), str(path))


def parse(text: str, file: str, unpacked: tuple[DrawnShow, str] | None = None) -> LoadedShow:
    """Parse the show in `text`. Raises: ShowError.

    Args:
        text: YAML.
        file: names it in errors; a drawing lies beside it.
        unpacked: its drawing with the SHA-256 of its bytes, where that was read before; None: read it.
    """
    try:
        source = Source(text, file)
        raw = source.mapping("about, origin, fleet, fence, timeline and duration_s")
    except FileError as error:
        raise ShowError(error.file, error.problems) from None
    show = drawing = None
    try:
        show = Show.model_validate(raw)
        flawed = flaws(show)
        if not flawed and show.drawing is not None:
            drawing, flawed = _drawing(show, show.drawing, Path(file).parent, unpacked)
    except ValidationError as error:
        flawed = [Flaw(misfit.loc, _within_cue(misfit)) for misfit in misfits(error, Show, source)]
    if flawed or show is None:
        raise ShowError(file, [located(flaw, source, _names(raw)) for flaw in flawed])
    return LoadedShow(Path(file).stem, file, show, Timeline.of(show, drawing), source, drawing)


def _drawing(
    show: Show, named: Drawing, folder: Path, unpacked: tuple[DrawnShow, str] | None
) -> tuple[DrawnShow | None, list[Flaw]]:
    """Return the drawing of a show, and what is wrong with it."""
    try:
        drawing, digest = unpacked or _read(folder / named.source)
    except ConfigError as error:
        return None, [Flaw(("drawing", "source"), str(error))]
    if digest != named.sha256:
        text = f"sha256: {named.source} has {digest}: it has changed, import it again"
        return None, [Flaw(("drawing", "sha256"), text)]
    return placed(drawing, show), list(drawing_flaws(show, drawing))


def placed(drawing: DrawnShow, show: Show) -> DrawnShow:
    """Return the drawing of a show where the show's placement has it."""
    if show.drawing is None or show.drawing.place == Placement():
        return drawing
    place = show.drawing.place
    moved = drawing.placed(place.turn_deg, np.array([place.x_m, place.y_m, 0.0]))
    return replace(moved, origin=show.origin.frame)


def _read(path: Path) -> tuple[DrawnShow, str]:
    drawing, data = read_drawing(path)
    return drawing, sha256(data).hexdigest()


def located(flaw: Flaw, source: Source, cues: list[str | None]) -> Problem:
    return Problem(source.line(*flaw.loc), _cue(flaw.loc, cues), flaw.text)


def _within_cue(misfit: Misfit) -> str:
    """Describe key, value and what is allowed; line and cue are shown beside it."""
    loc, key = misfit.loc, misfit.key
    if len(loc) > 2 and loc[0] == "timeline":
        key = key.removeprefix(f"timeline.{loc[1]}.")
    return str(misfit._replace(key=key))


def _cue(loc: Loc, cues: list[str | None]) -> str | None:
    if len(loc) < 2 or loc[0] != "timeline" or not isinstance(loc[1], int):
        return None
    return cues[loc[1]] if loc[1] < len(cues) else None


def _names(raw: dict[str, object]) -> list[str | None]:
    timeline = raw.get("timeline")
    entries = timeline if isinstance(timeline, list) else []
    names = [entry.get("cue") if isinstance(entry, dict) else None for entry in entries]
    return [None if name is None else str(name) for name in names]


ORIGIN_WITHIN_M = 0.5
"""Tolerance against the service's own origin: more is another field, or a mistake."""

HEADING_WITHIN_DEG = 0.1


def service_flaws(
    show: Show, frame: ShowFrame, control: ControlSettings, operation: OperationSettings, vehicles: int
) -> list[Flaw]:
    """Return all reasons why a service with so many vehicles would not fly the show as checked."""
    return [
        *origin_flaws(show, frame),
        *_limits(show, control),
        *_take_off(show, operation),
        *_exchanged_pads(show, operation),
        *_vehicles(show, vehicles),
    ]


def origin_flaws(show: Show, frame: ShowFrame) -> Iterator[Flaw]:
    """Yield where the show's origin is not the origin `frame` of a service."""
    origin = show.origin
    away_m = frame.position_m(
        np.array([origin.latitude_deg]), np.array([origin.longitude_deg]), np.array([origin.altitude_amsl_m])
    )[0]
    sideways_m, up_m = hypot(float(away_m[0]), float(away_m[1])), abs(float(away_m[2]))
    if not max(sideways_m, up_m) <= ORIGIN_WITHIN_M:
        text = f"{sideways_m:.1f} m sideways and {up_m:.1f} m in height from the service's show_frame"
        yield Flaw(("origin",), f"origin: {text}; at most {ORIGIN_WITHIN_M:g} m")
    turned_deg = abs((origin.heading_deg - frame.heading_deg + 180.0) % 360.0 - 180.0)
    if turned_deg > HEADING_WITHIN_DEG:
        text = f"origin.heading_deg = {origin.heading_deg:g}: the service's is {frame.heading_deg:g}"
        yield Flaw(("origin", "heading_deg"), text)


def _limits(show: Show, control: ControlSettings) -> Iterator[Flaw]:
    """Yield the service's limits that are narrower than those that the show was checked with."""
    limits, fence, safety = show.limits, show.fence, control.safety
    at_most = (
        *((f"limits.{key}", getattr(limits, key), of(control)) for key, of in AT_MOST.items()),
        ("fence.height_max_m", fence.height_max_m, safety.fence.height_max_m),
        ("fence.distance_max_m", fence.distance_max_m, safety.fence.distance_max_m),
    )
    for key, value, most in at_most:
        if value > most:
            yield Flaw(key.split("."), f"{key} = {value:g}: at most the service's {most:g}")
    at_least = (
        ("limits.separation_min_m", limits.separation_min_m, safety.floor.horizontal_m),
        ("fence.height_min_m", fence.height_min_m, safety.fence.height_min_m),
    )
    for key, value, least in at_least:
        if value < least:
            yield Flaw(key.split("."), f"{key} = {value:g}: at least the service's {least:g}")


def _take_off(show: Show, operation: OperationSettings) -> Iterator[Flaw]:
    for key in ("takeoff_height_m", "takeoff_stagger_s"):
        required, configured = getattr(show.fleet, key), getattr(operation, key)
        if required != configured:
            text = f"fleet.{key} = {required:g}: the service's operation.{key} is {configured:g}"
            yield Flaw(("fleet", key), text)


def _exchanged_pads(show: Show, operation: OperationSettings) -> Iterator[Flaw]:
    """Yield that a vehicle which returns by itself would land on its old pad, where another may stand."""
    if show.drawing is None or show.drawing.lands != "nearest" or operation.setpoint_loss_action != "return":
        return
    text = (
        "drawing.lands = nearest: the service's operation.setpoint_loss_action is 'return', to the old pads"
    )
    yield Flaw(("drawing", "lands"), text)


def _vehicles(show: Show, vehicles: int) -> Iterator[Flaw]:
    required = show.fleet.vehicles
    if required > vehicles:
        yield Flaw(("fleet", "vehicles"), f"fleet.vehicles = {required}: the service has {vehicles}")
