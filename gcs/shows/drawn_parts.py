"""The parts of a drawing that the cues of a show play, and the flaws of such cues. Pure."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from gcs.shows.drawn import DrawnShow
from gcs.shows.flaws import Flaw, of_value
from gcs.shows.format import Cue, Show

NEARLY = 1e-6
"""Tolerance for rounding errors."""

AREAS_MAX, CORNERS_MAX = 4, 60
"""Most areas of the fence of a drawing, and corners of each."""

OF_THE_LAW = ("over_s", "radius_m", "height_m", "target", "orbit", "spin", "lights")
"""Keys of a cue that a drawn part has no use for: it says where each vehicle is, and its light."""


@dataclass(frozen=True, slots=True)
class PlayedPart:
    """A part of the drawing as it is played: from `begin_s` on, at the drawing's own speed."""

    index: int  # of its cue in the file's timeline
    begin_s: float  # show's time
    from_s: float  # drawing's time then
    to_s: float  # drawing's time at its end

    @property
    def end_s(self) -> float:
        """Return the show's time at which it ends."""
        return self.begin_s + self.to_s - self.from_s


def drawn_s(parts: Sequence[PlayedPart], time_s: float) -> float | None:
    """Return the drawing's time at a time of the show; None while the law leads.

    From the end of a part up to the next cue, its last time holds.
    """
    at = bisect_right(parts, time_s, key=lambda part: part.begin_s) - 1
    return None if at < 0 else min(parts[at].from_s + time_s - parts[at].begin_s, parts[at].to_s)


def cue_flaws(show: Show) -> Iterator[Flaw]:
    """Yield what is wrong with drawing and drawn parts, as far as the show file shows it."""
    if (show.kind == "trajectories") != (show.drawing is not None):
        yield of_value(show.kind, "'trajectories' with a drawing, 'formation' without one", "kind")
    for index, cue in enumerate(show.timeline):
        if cue.trajectories is not None:
            yield from _part(cue, index, has_drawing=show.drawing is not None)
    spares = None if show.drawing is None else show.drawing.spares
    if spares is not None and spares.before_cue not in {cue.cue for cue in show.timeline}:
        yield of_value(spares.before_cue, "the name of a cue", "drawing", "spares", "before_cue")
    if show.drawing is not None and all(cue.trajectories is None for cue in show.timeline):
        yield Flaw(("drawing",), "no cue plays it: give one 'trajectories: {from_s, to_s}'")


def _part(cue: Cue, index: int, *, has_drawing: bool) -> Iterator[Flaw]:
    part = cue.trajectories
    if part is None:
        return
    if not has_drawing:
        yield Flaw(("timeline", index, "trajectories"), "trajectories: the show has no drawing to play")
    if not part.from_s < part.to_s:
        yield of_value(
            part.to_s, f"after from_s, {part.from_s:g} s", "timeline", index, "trajectories", "to_s"
        )
    for key in OF_THE_LAW:
        if getattr(cue, key) is not None:
            yield Flaw(("timeline", index, key), f"{key}: not beside trajectories, which say it themselves")


def span_flaws(parts: Sequence[PlayedPart], begins_s: Sequence[float], duration_s: float) -> Iterator[Flaw]:
    """Yield drawn parts that another cue interrupts, or that the show's end cuts off.

    Args:
        parts: in order of time.
        begins_s: times at which all cues are played, in order.
        duration_s: of the show.
    """
    for part in parts:
        later = bisect_right(begins_s, part.begin_s)
        limit_s = begins_s[later] if later < len(begins_s) else duration_s
        if part.end_s > limit_s + NEARLY:
            what = "the next cue begins" if later < len(begins_s) else "the show ends"
            text = f"trajectories: it plays until {part.end_s:.3f} s, {what} at {limit_s:g} s"
            yield Flaw(("timeline", part.index, "trajectories"), text)


def drawing_flaws(show: Show, drawing: DrawnShow) -> Iterator[Flaw]:
    """Yield where the show asks of its drawing what that does not have."""
    if show.fleet.vehicles != len(drawing):
        text = f"the drawing has {len(drawing)} vehicles"
        yield of_value(show.fleet.vehicles, text, "fleet", "vehicles")
    corners = max((len(polygon.points_m) for polygon in drawing.fence), default=0)
    if len(drawing.fence) > AREAS_MAX or corners > CORNERS_MAX:
        areas = f"{len(drawing.fence)} areas with up to {corners} corners"
        text = f"the fence of the drawing has {areas}: at most {AREAS_MAX} with {CORNERS_MAX} are kept"
        yield Flaw(("drawing",), text)
    for index, cue in enumerate(show.timeline):
        part = cue.trajectories
        if part is not None and part.to_s > drawing.duration_s + NEARLY:
            text = f"the drawing ends at {drawing.duration_s:g} s"
            yield of_value(part.to_s, text, "timeline", index, "trajectories", "to_s")
