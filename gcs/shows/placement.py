"""Where a drawn show lies on its field: fitted to where the vehicles stand, written into the show file. Pure.

A placement turns the drawing with its pads about the drawing's own origin, then moves it, in the show frame.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, degrees, hypot, radians, sin
from typing import Final, TypeAlias

import numpy as np
import scipy  # its parts are loaded on first use: 30 MB, which most flights do not need
from numpy.typing import NDArray

from gcs.config.yaml_files import Source
from gcs.model.errors import RefusedError
from gcs.model.frames import ShowFrame
from gcs.model.state import Array, Mask
from gcs.shows.drawn import DrawnShow
from gcs.shows.drawn.trajectories import bezier_of_power
from gcs.shows.format import Placement, Show
from gcs.shows.loading import origin_flaws
from gcs.shows.service_rules import ServiceRules

Complex: TypeAlias = NDArray[np.complex128]
Rows: TypeAlias = NDArray[np.intp]

FAR_M: Final = 10_000.0
"""A show from farther away begins at the frame's origin: over such distances a flat frame means nothing."""

SCANNED: Final = 360
"""Turns at which the pads are compared with the vehicles, each with its nearest."""

TRIED: Final = 12
"""The best of these turns, from which a fit is searched."""

STEPS_MAX: Final = 30

AS_GOOD_M, AS_GOOD_SHARE = 0.02, 1.05
"""Fits that are worse than the best one by no more than this are as good: the least turn decides."""


def in_frame(show: Show, frame: ShowFrame) -> Placement:
    """Return the placement of a drawn show as it is now, in the frame of another origin.

    A show from more than `FAR_M` away begins where that frame does. Heights stay above the origin.
    """
    place, origin = place_of(show), show.origin
    there_m = frame.position_m(
        np.array([origin.latitude_deg]), np.array([origin.longitude_deg]), np.array([frame.altitude_amsl_m])
    )[0]
    if not hypot(*there_m.tolist()) <= FAR_M:  # z is included: the other side of the globe is straight below
        return place
    turn_deg = origin.heading_deg - frame.heading_deg
    c, s = cos(radians(turn_deg)), sin(radians(turn_deg))
    x_m, y_m = c * place.x_m - s * place.y_m + there_m[0], s * place.x_m + c * place.y_m + there_m[1]
    return placement(float(x_m), float(y_m), turn_deg + place.turn_deg)


def placement(x_m: float, y_m: float, turn_deg: float) -> Placement:
    """Return a placement in whole centimetres and hundredths of a degree, turned by -180 to 180 degrees."""
    wrapped_deg = (turn_deg + 180.0) % 360.0 - 180.0
    return Placement(x_m=round(x_m, 2) + 0.0, y_m=round(y_m, 2) + 0.0, turn_deg=round(wrapped_deg, 2) + 0.0)


def place_of(show: Show) -> Placement:
    """Return the placement in the show file. Raises: RefusedError for a show without a drawing."""
    if show.drawing is None:
        raise RefusedError("the show has no drawing to place")
    return show.drawing.place


@dataclass(frozen=True, slots=True, eq=False)
class Stand:
    """How n vehicles stand beside the m pads of a placed show."""

    place: Placement
    pads_m: Array  # (m, 2) show frame
    pad: Rows  # (n,) row of each vehicle's pad; -1: none
    off_m: Array  # (n,) distance from it; NaN: no pad, or no position

    @property
    def rms_m(self) -> float:
        """Root mean square of the distances; NaN for none."""
        located_m = self.off_m[np.isfinite(self.off_m)]
        return float(np.sqrt((located_m**2).mean())) if len(located_m) else np.nan


def stand(show: Show, place: Placement, standing_m: Array) -> Stand:
    """Return how vehicles stand beside the pads of a show with this placement.

    Args:
        show: with a drawing.
        place: replaces its own.
        standing_m: (n, 2) where they stand, in the fleet's order, show frame; NaN where not known.
    """
    pads, located = _line(placed_pads_m(show, place)), _known(standing_m)
    pad, off_m = np.full(len(standing_m), -1, np.intp), np.full(len(standing_m), np.nan)
    pad[located] = _matched(pads, _line(standing_m[located]), _own(show, located))
    has = pad >= 0
    off_m[has] = np.abs(_line(standing_m[has]) - pads[pad[has]])
    return Stand(place, np.stack([pads.real, pads.imag], axis=1), pad, off_m)


def fitted(show: Show, begin: Placement, standing_m: Array) -> Placement:
    """Return the placement with the least sum of squared distances between vehicles and their pads.

    Which vehicle gets which pad is part of the search, unless the drawing assigns its pads in the fleet's
    order. Of placements that are as good (a square has four) the one with the least turn from `begin` counts.

    Args:
        show: with a drawing.
        begin: where the search begins.
        standing_m: (n, 2) as of `stand`.

    Raises: RefusedError when no vehicle has a known position.
    """
    located = _known(standing_m)
    if _in_order(show):
        located[show.fleet.vehicles :] = False  # they have no pad
    if not located.any():
        raise RefusedError("no vehicle on the ground has a known position: there is nothing to fit to")
    pads, places, own = _line(show.drawn_pads_m), _line(standing_m[located]), _own(show, located)
    fits = [
        _searched(pads, places, own, turn, move) for turn, move in _begins(pads, places, own is None, begin)
    ]
    best_m = min(rms_m for _, _, rms_m in fits)
    good = [fit for fit in fits if fit[2] <= AS_GOOD_SHARE * best_m + AS_GOOD_M]
    first = np.exp(1j * radians(begin.turn_deg))
    middle = pads.mean()
    there = first * middle + complex(begin.x_m, begin.y_m)
    turn, move, _ = min(
        good,
        key=lambda fit: (
            round(abs(float(np.angle(fit[0] / first))), 2),
            abs(fit[0] * middle + fit[1] - there),
        ),
    )
    return placement(move.real, move.imag, degrees(float(np.angle(turn))))


def _begins(pads: Complex, places: Complex, free: bool, begin: Placement) -> list[tuple[complex, complex]]:
    """Return turns and moves from which a fit is searched: as it is, and those that look best."""
    first = complex(np.exp(1j * radians(begin.turn_deg)))
    as_is = first, complex(begin.x_m, begin.y_m)
    if not free or len(places) == 1 or len(pads) == 1:
        return [as_is]
    turns = first * np.exp(2j * np.pi * np.arange(SCANNED) / SCANNED)
    middle, there = pads.mean(), first * pads.mean() + as_is[1]
    begins = [as_is]
    few, many = (pads, places) if len(pads) < len(places) else (places, pads)
    for to in (places.mean(), there):
        moves = to - turns * middle
        back = turns if few is pads else np.conj(turns)
        moved = back[:, None] * few + (moves if few is pads else -back * moves)[:, None]
        tree = scipy.spatial.KDTree(np.stack([many.real, many.imag], axis=1))
        away_m, _ = tree.query(np.stack([moved.real, moved.imag], axis=2))
        cost = (np.asarray(away_m) ** 2).sum(axis=1)
        least = np.flatnonzero((cost <= np.roll(cost, 1)) & (cost <= np.roll(cost, -1)))
        chosen = least[np.argsort(cost[least], kind="stable")[:TRIED]]
        begins += [(complex(turns[at]), complex(moves[at])) for at in chosen]
    return begins


def _searched(
    pads: Complex, places: Complex, own: Rows | None, turn: complex, move: complex
) -> tuple[complex, complex, float]:
    """Improve a placement until the assignment stays. Returns: turn, move and the rms distance in m."""
    before: Rows | None = None
    for _ in range(STEPS_MAX):
        rows = _matched(turn * pads + move, places, own)
        if before is not None and (rows == before).all():
            break
        before, has = rows, rows >= 0
        turn, move = _rigid(pads[rows[has]], places[has], turn)
    rows = _matched(turn * pads + move, places, own)
    has = rows >= 0
    off_m = np.abs(places[has] - turn * pads[rows[has]] - move)
    return turn, move, float(np.sqrt((off_m**2).mean()))


def _rigid(p: Complex, q: Complex, turn: complex) -> tuple[complex, complex]:
    """Return the least-squares rotation and shift: q is turn * p + move. `turn` holds where none shows."""
    lever = (np.conj(p - p.mean()) * (q - q.mean())).sum()
    turn = complex(lever / abs(lever)) if abs(lever) > 1e-6 else turn
    return turn, complex(q.mean() - turn * p.mean())


def _matched(pads: Complex, places: Complex, own: Rows | None) -> Rows:
    """(n,) The pad of each place, -1 for none: least sum of squared distances, or the `own` ones."""
    if own is not None:
        return own
    pad_of = np.full(len(places), -1, np.intp)
    rows, columns = scipy.optimize.linear_sum_assignment(np.abs(places[:, None] - pads[None]) ** 2)
    pad_of[rows] = columns
    return pad_of


def _own(show: Show, located: NDArray[np.bool_]) -> Rows | None:
    """Return the pads of the known vehicles where the fleet's order decides them; None where it does not."""
    if not _in_order(show):
        return None
    rows = np.flatnonzero(located)
    return np.where(rows < show.fleet.vehicles, rows, -1)


def _in_order(show: Show) -> bool:
    """Return whether the fleet's order decides which vehicle has which pad."""
    return show.drawing is not None and show.drawing.pads == "file"


def placed_pads_m(show: Show, place: Placement) -> Array:
    """(m, 2) Pads of a show with another placement than its own, show frame."""
    return np.asarray(place.placed_m(show.drawn_pads_m)[:, :2])


def _known(place_m: Array) -> Mask:
    """(n,) Which of the places (n, 2) are known."""
    return np.asarray(np.isfinite(place_m).all(axis=1))


def _line(place_m: Array) -> Complex:
    return np.asarray(place_m[:, 0] + 1j * place_m[:, 1])


def standing_on(pads_m: Array, standing_m: Array, within_m: float) -> Rows:
    """(n,) The pad on which each vehicle stands; -1: on none, or another one stands nearer to it.

    Args:
        pads_m: (m, 2) at least one.
        standing_m: (n, 2), NaN where not known.
        within_m: of its pad.
    """
    away_m = np.abs(_line(standing_m)[:, None] - _line(pads_m)[None])
    away_m = np.where(np.isfinite(away_m), away_m, np.inf)
    pad, vehicles = away_m.argmin(axis=1), np.arange(len(standing_m))
    stands = (away_m[vehicles, pad] <= within_m) & (away_m.argmin(axis=0)[pad] == vehicles)
    return np.where(stands, pad, -1)


# the show file


def farthest_m(show: Show, drawing: DrawnShow, place: Placement) -> float:
    """Distance over the ground, from the origin, that no pad and no vehicle of the placed drawing exceeds.

    `drawing` is as the show has it, with the show's own placement.
    """
    points_m = bezier_of_power(drawing.trajectories.coefficients_m).reshape(-1, 3)
    drawn_m = place_of(show).unplaced_m(np.concatenate([points_m, drawing.home_m]))
    return float(np.hypot(*place.placed_m(np.concatenate([drawn_m, show.drawn_pads_m]))[:, :2].T).max())


def fence_m(show: Show, drawing: DrawnShow, place: Placement, rules: ServiceRules | None = None) -> float:
    """Distance of the show's fence with another placement: what is left to it stays as it is.

    It is no wider than the fence of the service that is to fly it, if that is known.
    """
    left_m = show.fence.distance_max_m - farthest_m(show, drawing, place_of(show))
    distance_m = round(farthest_m(show, drawing, place) + left_m, 1)
    return distance_m if rules is None else rules.fenced(show.fence.height_max_m, distance_m).distance_max_m


def placed_text(
    source: Source,
    text: str,
    show: Show,
    fence: float,
    place: Placement,
    to: ShowFrame,
    rules: ServiceRules | None = None,
) -> str:
    """Return the show file with another placement, in the frame of another origin; comments stay.

    Args:
        source: of the text.
        text: the show file.
        show: what it says.
        fence: distance of its fence with that placement, in m.
        place: in the frame `to`.
        to: replaces the show's origin, unless that is the same within the service's tolerance.
        rules: of the service that is to fly it: its take-off replaces the show's; None: not known.
    """
    changes: dict[Sequence[str], str] = {
        ("drawing", "place"): f"{{x_m: {place.x_m:g}, y_m: {place.y_m:g}, turn_deg: {place.turn_deg:g}}}"
    }
    if fence != show.fence.distance_max_m:
        changes["fence", "distance_max_m"] = f"{fence:g}"
    if not same_frame(show, to):
        changes |= {
            ("origin", "latitude_deg"): f"{to.latitude_deg:.10g}",
            ("origin", "longitude_deg"): f"{to.longitude_deg:.10g}",
            ("origin", "altitude_amsl_m"): f"{to.altitude_amsl_m:.10g}",
            ("origin", "heading_deg"): f"{to.heading_deg:.10g}",
        }
    for key in ("takeoff_height_m", "takeoff_stagger_s"):
        if rules is not None and getattr(rules, key) != getattr(show.fleet, key):
            changes["fleet", key] = f"{getattr(rules, key):.10g}"
    return source.changed(text, changes)


def same_frame(show: Show, frame: ShowFrame) -> bool:
    """Return whether a service with this frame takes the show's origin for its own."""
    return not list(origin_flaws(show, frame))


def stand_document(
    show: Show, stand: Stand, standing: Mapping[str, Sequence[float] | None]
) -> dict[str, object]:
    """Return how vehicles stand beside the pads, for JSON. `standing` is by name, in the fleet's order."""
    vehicles = []
    for row, (name, at_m) in enumerate(standing.items()):
        pad, off_m = int(stand.pad[row]), float(stand.off_m[row])
        vehicles.append(
            {
                "id": name,
                "x_m": None if at_m is None else round(at_m[0], 2),
                "y_m": None if at_m is None else round(at_m[1], 2),
                "pad": None if pad < 0 else pad,
                "off_m": None if not np.isfinite(off_m) else round(off_m, 3),
            }
        )
    known_m = stand.off_m[np.isfinite(stand.off_m)]
    return {
        "assigned": "file" if _in_order(show) else "nearest",
        **stand.place.model_dump(),
        "pads_m": [[round(float(x_m), 3), round(float(y_m), 3)] for x_m, y_m in stand.pads_m],
        "vehicles": vehicles,
        "rms_m": round(stand.rms_m, 3) if len(known_m) else None,
        "max_m": round(float(known_m.max()), 3) if len(known_m) else None,
    }
