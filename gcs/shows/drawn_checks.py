"""Checks the drawn parts of a show without a flight: spacing, speeds, fence, the file's claims. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy  # its parts are loaded on first use: 30 MB, which most flights do not need

from gcs.model.state import Array
from gcs.safety.fenced_areas import beyond_m
from gcs.shows.drawn import Claims, DrawnShow
from gcs.shows.drawn_parts import PlayedPart
from gcs.shows.flaws import Flaw
from gcs.shows.format import Show
from gcs.shows.timeline import Timeline

SAMPLED_S: Final = 0.1
PAIRS_NAMED: Final = 10
"""Most pairs that a flaw names."""

JUMP_S: Final = 0.5
"""Accelerations are means over this time, the lag of a vehicle: no vehicle follows a shorter one."""

MID_AIR_M: Final = 0.5
"""A trajectory that ends higher than this above the take-off's height ends in mid-air."""

NEARLY: Final = 0.01
"""Tolerance of limits and claims, as a share: files are rounded."""


@dataclass(frozen=True, slots=True)
class Claim:
    """What the file says that its show keeps to, and what its drawing does."""

    name: str
    claimed: float
    measured: float
    holds: bool


@dataclass(frozen=True, slots=True)
class DrawnFigures:
    """Figures of all drawn parts of a show, as they are drawn."""

    separation_min_m: float | None  # in the metric of the separation ellipsoid; None: one vehicle
    separation_min_at_s: float | None  # time of the drawing
    closest: tuple[str, str] | None  # names of the file
    pairs_below_floor: int
    speed_max_m_s: float  # sideways
    climb_max_m_s: float
    sink_max_m_s: float
    acceleration_max_m_s2: float
    height_max_m: float
    claims: tuple[Claim, ...] = ()
    mid_air: str = ""  # drones of which the drawing ends there, and what becomes of them


@dataclass(frozen=True, slots=True, eq=False)
class _Sampled:
    """One part: k times, n vehicles, show frame."""

    part: PlayedPart
    time_s: Array  # (k,) of the drawing
    position_m: Array  # (k, n, 3)
    velocity_m_s: Array  # (k, n, 3)


def examine(timeline: Timeline) -> tuple[DrawnFigures, list[Flaw]]:
    """Return figures and flaws of the drawn parts. Needs a timeline with its drawing."""
    drawing, show = timeline.drawing, timeline.show
    if drawing is None:
        raise ValueError("a timeline with a drawing is needed")
    first = {part.index: part for part in reversed(timeline.parts)}  # loops repeat a part
    flaws = list(_fence_flaws(timeline))
    pairs: dict[tuple[int, int], tuple[float, float]] = {}
    least = (np.inf, 0.0, (0, 0))
    most = np.zeros(5)
    for index in sorted(first):
        sampled = _sampled(drawing, first[index])
        closest, below = _spacing(show, sampled)
        least = min(least, closest)
        for pair, near in below.items():
            pairs[pair] = min(near, pairs.get(pair, near))
        most = np.maximum(most, _motion(sampled))
        flaws += [*_close(show, drawing, index, below), *_fast(show, sampled), *_outside(show, sampled)]
        flaws += [*_turns(show, drawing, sampled), *_beyond_areas(timeline, sampled)]
    measured = np.isfinite(least[0])
    names = drawing.vehicles
    figures = DrawnFigures(
        separation_min_m=_short(least[0]) if measured else None,
        separation_min_at_s=_short(least[1]) if measured else None,
        closest=(names[least[2][0]], names[least[2][1]]) if measured else None,
        pairs_below_floor=len(pairs),
        speed_max_m_s=_short(most[0]),
        climb_max_m_s=_short(most[1]),
        sink_max_m_s=_short(most[2]),
        acceleration_max_m_s2=_short(most[3]),
        height_max_m=_short(most[4]),
        claims=tuple(_claims(drawing.claims, (least[0], *most[[0, 1, 2, 4]].tolist()))),
        mid_air=_mid_air(show, drawing),
    )
    return figures, flaws


def _mid_air(show: Show, drawing: DrawnShow) -> str:
    """Name the drones of which the trajectory ends higher than the station's take-off, the highest first."""
    end_m, ends_s = -drawing.trajectories.at(drawing.duration_s).position_m[:, 2], drawing.trajectories.end_s
    rows = np.flatnonzero(end_m > show.fleet.takeoff_height_m + MID_AIR_M)
    rows = rows[np.argsort(-end_m[rows], kind="stable")]
    ends = [f"{drawing.vehicles[row]} at {end_m[row]:.1f} m ({ends_s[row]:.1f} s)" for row in rows.tolist()]
    if not ends:
        return ""
    more = f" and {len(ends) - PAIRS_NAMED} more" if len(ends) > PAIRS_NAMED else ""
    then = "they stay there until the show ends, then the station brings them home"
    return f"the drawing ends in mid-air for {', '.join(ends[:PAIRS_NAMED])}{more}: {then}"


def _sampled(drawing: DrawnShow, part: PlayedPart) -> _Sampled:
    time_s = np.append(np.arange(part.from_s, part.to_s, SAMPLED_S), part.to_s - 1e-6)
    motions = [drawing.trajectories.at(at_s) for at_s in time_s.tolist()]
    position_m = np.stack([motion.position_m for motion in motions])
    return _Sampled(part, time_s, position_m, np.stack([motion.velocity_m_s for motion in motions]))


Near = tuple[float, float]
"""A distance in m, and the drawing's time of it."""


def _spacing(
    show: Show, sampled: _Sampled
) -> tuple[tuple[float, float, tuple[int, int]], dict[tuple[int, int], Near]]:
    """Return the closest pair with distance and time, and the least distance of each pair below the floor."""
    floor = show.control.safety.floor
    stretch = np.array([1.0, 1.0, floor.horizontal_m / floor.vertical_m])
    least, below = (np.inf, 0.0, (0, 0)), dict[tuple[int, int], Near]()
    if sampled.position_m.shape[1] < 2:
        return least, below
    for time_s, position_m in zip(sampled.time_s.tolist(), sampled.position_m * stretch, strict=True):
        tree = scipy.spatial.cKDTree(position_m)
        away_m, other = map(np.asarray, tree.query(position_m, k=2))
        row = int(away_m[:, 1].argmin())
        nearest_m = float(away_m[row, 1])
        if nearest_m < least[0]:
            low, high = sorted((row, int(other[row, 1])))
            least = nearest_m, time_s, (low, high)
        if nearest_m < floor.horizontal_m:
            for low, high in tree.query_pairs(floor.horizontal_m):
                near = float(np.linalg.norm(position_m[low] - position_m[high])), time_s
                below[low, high] = min(near, below.get((low, high), near))
    return least, below


def _close(show: Show, drawing: DrawnShow, index: int, below: dict[tuple[int, int], Near]) -> Iterator[Flaw]:
    if not below:
        return
    floor_m, names = show.control.safety.floor.horizontal_m, drawing.vehicles
    worst = sorted(below.items(), key=lambda item: item[1])[:PAIRS_NAMED]
    reported = [
        f"{names[low]} and {names[high]} {away_m:.2f} m at {time_s:.1f} s"
        for (low, high), (away_m, time_s) in worst
    ]
    more = ", ..." if len(below) > PAIRS_NAMED else ""
    text = f"{len(below)} pairs are drawn closer than the floor of {floor_m:g} m: {', '.join(reported)}{more}"
    yield Flaw(("timeline", index, "trajectories"), f"trajectories: {text} (times of the drawing)")


def drawn_within(timeline: Timeline, row: int, size_m: tuple[float, float], until_s: float) -> str:
    """Name the vehicle that is drawn deepest in the ellipsoid about another by a time of the show, and when.

    Args:
        timeline: with its drawing.
        row: of the other one, in the drawing.
        size_m: semi-axes of the ellipsoid, sideways and up.
        until_s: time of the show.

    Returns: "" where none is drawn inside.
    """
    semi_m, deepest, named = np.array([size_m[0], size_m[0], size_m[1]]), 1.0, ""
    for time_s in np.arange(0.0, until_s, SAMPLED_S).tolist():
        motion, drawn_s = timeline.motion_at(time_s), timeline.drawn_s(time_s)
        if timeline.drawing is None or motion is None or drawn_s is None:
            continue
        away_m = np.abs(motion.position_m - motion.position_m[row])
        shares = np.linalg.norm(away_m / semi_m, axis=1)
        shares[row] = np.inf
        other, names = int(shares.argmin()), timeline.drawing.vehicles
        if shares[other] < deepest:
            deepest, apart_m = float(shares[other]), np.hypot(*away_m[other, :2])
            named = (
                f"{names[row]} and {names[other]} are drawn {apart_m:.2f} m apart sideways and"
                f" {away_m[other, 2]:.2f} m in height at {drawn_s:.1f} s of the drawing"
            )
    return named


def _motion(sampled: _Sampled) -> Array:
    """(5,) Greatest speed sideways, climb, sink, acceleration and height."""
    velocity_m_s = sampled.velocity_m_s
    return np.array(
        [
            np.hypot(velocity_m_s[:, :, 0], velocity_m_s[:, :, 1]).max(),
            np.max(-velocity_m_s[:, :, 2], initial=0.0),
            np.max(velocity_m_s[:, :, 2], initial=0.0),
            _accelerations_m_s2(sampled).max(initial=0.0),
            -sampled.position_m[:, :, 2].min(),
        ]
    )


def _accelerations_m_s2(sampled: _Sampled) -> Array:
    """(j, n) Mean accelerations over `JUMP_S`."""
    steps = round(JUMP_S / SAMPLED_S)
    change_m_s = sampled.velocity_m_s[steps:] - sampled.velocity_m_s[:-steps]
    return np.asarray(np.linalg.norm(change_m_s, axis=2) / JUMP_S)


def _fast(show: Show, sampled: _Sampled) -> Iterator[Flaw]:
    """Yield what no vehicle can follow, with the worst vehicle and time."""
    velocity_m_s, limits = sampled.velocity_m_s, show.limits
    kinds = (
        ("sideways", np.hypot(velocity_m_s[:, :, 0], velocity_m_s[:, :, 1]), limits.speed_max_m_s, "m/s"),
        ("up", -velocity_m_s[:, :, 2], limits.climb_max_m_s, "m/s"),
        ("down", velocity_m_s[:, :, 2], limits.sink_max_m_s, "m/s"),
        (
            f"of acceleration over {JUMP_S:g} s",
            _accelerations_m_s2(sampled),
            show.control.acceleration_max_m_s2,
            "m/s^2",
        ),
    )
    for what, values, most, unit in kinds:
        if values.max(initial=0.0) > most * (1.0 + NEARLY):
            yield _worst(sampled, what, values, most, unit)


def _worst(sampled: _Sampled, what: str, values: Array, most: float, unit: str) -> Flaw:
    at, row = np.unravel_index(int(values.argmax()), values.shape)
    when = f"vehicle {row + 1} of the drawing at {sampled.time_s[at]:.1f} s"
    text = f"trajectories: {values.max():.2f} {unit} {what}, at most {most:g} {unit}: {when}"
    return Flaw(("timeline", sampled.part.index, "trajectories"), text)


def _turns(show: Show, drawing: DrawnShow, sampled: _Sampled) -> Iterator[Flaw]:
    """Yield a drawn yaw that turns faster than a vehicle is turned, if the show flies it."""
    if show.drawing is None or show.drawing.yaw != "drawn":
        return
    yaw_rad = np.stack([drawing.yaw.at(time_s) for time_s in sampled.time_s.tolist()])
    rate_deg_s = np.degrees(np.abs(np.diff(yaw_rad, axis=0))) / np.diff(sampled.time_s)[:, None]
    most = show.control.yaw_rate_max_deg_s
    rate_deg_s = np.nan_to_num(rate_deg_s, nan=0.0)
    if rate_deg_s.max(initial=0.0) > most * (1.0 + NEARLY):
        yield _worst(sampled, "of yaw", rate_deg_s, most, "deg/s")


def _outside(show: Show, sampled: _Sampled) -> Iterator[Flaw]:
    fence, position_m = show.fence, sampled.position_m
    height_m, far_m = -position_m[:, :, 2], np.hypot(position_m[:, :, 0], position_m[:, :, 1])
    beyond: Sequence[tuple[str, Array]] = (
        ("above the fence", height_m - fence.height_max_m),
        ("below the fence", fence.height_min_m - height_m),
        ("beyond the fence", far_m - fence.distance_max_m),
    )
    for what, over_m in beyond:
        if over_m.max() > NEARLY:
            yield _worst(sampled, what, over_m, 0.0, "m")


def _beyond_areas(timeline: Timeline, sampled: _Sampled) -> Iterator[Flaw]:
    """Yield a vehicle that is drawn beyond the file's own fence, with time and place."""
    areas = timeline.areas
    if not areas or timeline.drawing is None:
        return
    over_m = np.stack([beyond_m(areas, place_m[:, :2]) for place_m in sampled.position_m])
    at, row = np.unravel_index(int(over_m.argmax()), over_m.shape)
    if over_m[at, row] > NEARLY:
        name, (x_m, y_m) = timeline.drawing.vehicles[row], sampled.position_m[at, row, :2]
        text = f"trajectories: {name} is {over_m[at, row]:.2f} m beyond the fence of the drawing"
        where = f"at {sampled.time_s[at]:.1f} s of the drawing, x {x_m:.1f} m, y {y_m:.1f} m"
        yield Flaw(("timeline", sampled.part.index, "trajectories"), f"{text} {where}")


def _fence_flaws(timeline: Timeline) -> Iterator[Flaw]:
    """Yield pads beyond the file's own fence."""
    pads_m = timeline.show.start_places_m[:, :2]
    over_m = beyond_m(timeline.areas, pads_m)
    if over_m.max(initial=-np.inf) > NEARLY:
        row = int(over_m.argmax())
        text = f"pad {row + 1} is {over_m[row]:.2f} m beyond the fence of the drawing"
        more = f", and {int((over_m > NEARLY).sum()) - 1} more are" if (over_m > NEARLY).sum() > 1 else ""
        yield Flaw(("fleet", "pads"), f"pads: {text}{more}")


def _claims(claims: Claims, measured: tuple[float, ...]) -> Iterator[Claim]:
    kinds = (
        ("separation_min_m", claims.separation_min_m),
        ("speed_max_m_s", claims.speed_max_m_s),
        ("climb_max_m_s", claims.climb_max_m_s),
        ("sink_max_m_s", claims.sink_max_m_s),
        ("height_max_m", claims.height_max_m),
    )
    for (name, claimed), value in zip(kinds, measured, strict=True):
        if claimed is None or not np.isfinite(value):
            continue
        least = name == "separation_min_m"
        holds = value >= claimed * (1.0 - NEARLY) if least else value <= claimed * (1.0 + NEARLY)
        yield Claim(name, _short(claimed), _short(value), holds)


def _short(value: float) -> float:
    return round(float(value), 2)
