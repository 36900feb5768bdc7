"""Record of a simulated flight, tick by tick, and how close it came to vehicles and obstacles.

Pairs are deliberately computed without the code that flies.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.formation.obstacles import Ellipse
from gcs.model.jit import kernel
from gcs.model.plan import Obstacle
from gcs.model.state import Array, Mask
from gcs.simulation.crossing import Passage
from gcs.simulation.lies import Liars
from gcs.simulation.scenario import FormationFlight, Scenario
from gcs.simulation.shortest_ways import shortest_paths_m

Index: TypeAlias = NDArray[np.intp]

NOWHERE = np.full(3, np.nan)

STEADY_S: Final = 5.0
"""The last of a flight, in which it is at rest."""


def rounded(value: float | None, digits: int = 3) -> float | None:
    """Round for output; None for None and infinity, which JSON cannot represent."""
    return None if value is None or not np.isfinite(value) else round(value, digits)


@dataclass(slots=True, eq=False)
class FlightDetails:
    """What no figure needs, with one entry per tick: kept only where it is asked for."""

    velocity_m_s: list[NDArray[np.float32]] = field(default_factory=list)  # (n, 3) true
    setpoint_m_s: list[NDArray[np.float32]] = field(default_factory=list)  # (n, 3) sent then, NaN: none
    limited_by: list[tuple[str, ...]] = field(default_factory=list)  # (n,) as in `gcs.control.Tick`
    task: list[NDArray[np.int8]] = field(default_factory=list)  # (n,) of `gcs.control.Task`


@dataclass(slots=True, eq=False)
class FlightRecord:
    """A flight of n vehicles, with one entry per tick. The flight fills it, and the metrics read it."""

    scenario: Scenario
    seed: int
    start_m: Array  # (n, 3)
    goal_m: Array  # (n, 3), NaN without
    floor_m: float
    time_s: list[float] = field(default_factory=list)
    position_m: list[Array] = field(default_factory=list)  # (n, 3) true
    formed: list[Mask] = field(default_factory=list)  # (n,) in formation
    in_air: list[Mask] = field(default_factory=list)  # (n,)
    center_m: list[Array] = field(default_factory=list)  # (3,) commanded
    radius_m: list[float] = field(default_factory=list)
    target_m: list[Array] = field(default_factory=list)  # (2,)
    boxes: list[tuple[Obstacle, ...]] = field(default_factory=list)  # at their positions now
    closest_m: list[float] = field(default_factory=list)  # in the floor's metric, over the tick's steps
    limited: list[int] = field(default_factory=list)  # number of vehicles that the safety filter limited
    held_by: list[str] = field(default_factory=list)  # obstacle that keeps the centre from its target, or ""
    tick_s: list[float] = field(default_factory=list)  # processor time of each decision
    violating: set[tuple[int, int]] = field(default_factory=set)  # pairs
    lost_rows: frozenset[int] = frozenset()  # vehicles that lose their links
    charge: Array | None = None  # (n,), None: all alike
    expected: Mask = field(init=False)  # (n,) vehicles that must arrive: not lost, and with a clear goal
    off_slot_m: list[Array] = field(
        default_factory=list
    )  # (n,) distance of each vehicle from its slot, with losses or on a sphere that stands; NaN: none, or
    # closed to it
    slot_m: Array = field(init=False)  # (n, 3) the newest slots, where `off_slot_m` has distances
    liars: Liars | None = None  # vehicles that report what is not so; None: all report truly
    passages: list[Passage] | None = None  # of traffic; None: there is none
    law_failed: tuple[float, str] | None = None  # when the law was relied on no more, and why
    failsafes: list[tuple[float, str, str]] = field(default_factory=list)  # time, cause, action
    orbit_radius_m: float = 0.0
    busy_s: float = 0.0  # processor time of the whole flight
    carried_s: tuple[float, ...] = ()  # when a carried vehicle was held, let go, and the flight ends
    changed_s: float = 0.0  # start of settling: engagement, or the last event
    way_s: Array | None = None  # (n,) duration of the shortest ways past boxes; None: of straight ones
    planning_s: float | None = None  # processor time of the collective return's plan; None: none was made
    details: FlightDetails | None = None
    within_m_s: list[Array] | None = None  # (n, 3) true velocities within a site; None: there is none

    def __post_init__(self) -> None:
        self.expected = np.ones(len(self.start_m), dtype=np.bool_)
        self.slot_m = np.full_like(self.start_m, np.nan)

    @property
    def count(self) -> int:
        return len(self.start_m)

    @property
    def law(self) -> str | None:
        """The name of the law that leads the formation; None: there is no formation."""
        flight = self.scenario.flight
        return flight.law if isinstance(flight, FormationFlight) else None

    def charges(self, rows: Mask) -> tuple[float, ...]:
        """Charges of the vehicles in `rows` (n,)."""
        charge = np.ones(self.count) if self.charge is None else self.charge
        return tuple(charge[rows].tolist())

    @property
    def path_m(self) -> Array:
        """(ticks, n, 3) true positions."""
        return np.array(self.position_m, dtype=np.float64)


FAR_M = 1e9


@kernel
def closest_m(
    position_m: Array, in_air: Mask, present: Mask, scale_z: float, pad_height_m: float, inside_m: float
) -> tuple[float, int]:
    """Smallest distance of the pairs that count, heights times `scale_z`, and the number within `inside_m`.

    A pair counts when at least one vehicle is airborne and not both are below `pad_height_m`.
    """
    n = len(position_m)
    least_m2, inside, place = FAR_M * FAR_M, 0, np.ascontiguousarray(position_m.T)
    for i in range(n):
        if not present[i]:
            continue
        x, y, z = position_m[i, 0], position_m[i, 1], position_m[i, 2]
        low, limit_m2, some = -z < pad_height_m, max(least_m2, inside_m * inside_m), 0
        for j in range(i):  # without branches, so that it is vectorised
            dx, dy, dz = place[0, j] - x, place[1, j] - y, (place[2, j] - z) * scale_z
            some += dx * dx + dy * dy + dz * dz < limit_m2
        for j in range(i if some else 0):
            dx = position_m[j, 0] - x
            dy = position_m[j, 1] - y
            dz = (position_m[j, 2] - z) * scale_z
            distance_m2 = dx * dx + dy * dy + dz * dz
            if distance_m2 < least_m2 or distance_m2 < inside_m * inside_m:
                counts = present[j] and (in_air[i] or in_air[j])
                if counts and not (low and -position_m[j, 2] < pad_height_m):
                    least_m2 = min(least_m2, distance_m2)
                    if distance_m2 < inside_m * inside_m:
                        inside += 1
    return np.sqrt(least_m2), inside


@kernel
def pairs_inside(
    position_m: Array,
    in_air: Mask,
    present: Mask,
    scale_z: float,
    pad_height_m: float,
    inside_m: float,
    count: int,
) -> Index:
    """(count, 2) rows of the pairs that `closest_m` counts within `inside_m`, the smaller row first."""
    pairs, number = np.empty((count, 2), np.intp), 0
    for i in range(len(position_m)):
        low = -position_m[i, 2] < pad_height_m
        for j in range(i if present[i] else 0):
            if not present[j] or not (in_air[i] or in_air[j]) or (low and -position_m[j, 2] < pad_height_m):
                continue
            dx = position_m[j, 0] - position_m[i, 0]
            dy = position_m[j, 1] - position_m[i, 1]
            dz = (position_m[j, 2] - position_m[i, 2]) * scale_z
            if dx * dx + dy * dy + dz * dz < inside_m * inside_m and number < count:
                pairs[number, 0], pairs[number, 1] = j, i
                number += 1
    return pairs[:number]


PENETRATION_M = 1.0

NEAR_M = 15.0
"""Vehicles farther from a box than this ignore it."""

NEARER_M_S = 0.5
"""A vehicle that approaches a box more slowly than this has passed it: jitter is not an approach."""

THROUGH_M = 2.0
"""Largest final distance of vehicles from the sphere, and of the sphere from its destination."""


def penetrations_and_clearance_m(record: FlightRecord) -> tuple[int, float]:
    """Number of vehicles inside a box grown by 1 m, sides and top; and least distance to a box.

    Those that have lost their links in a formation do not count: nothing can lead them out of the way.
    """
    inside, least_m = np.zeros(record.count, dtype=bool), np.inf
    flight, lost = record.scenario.flight, np.isin(np.arange(record.count), list(record.lost_rows))
    lost_s = flight.loss.at_s if isinstance(flight, FormationFlight) else np.inf
    ticks = zip(record.time_s, record.boxes, record.position_m, record.in_air, strict=True)
    for time_s, boxes, position_m, in_air in ticks:
        if boxes:
            flying = in_air & ~lost if time_s >= lost_s else in_air
            beyond_m = _beyond_m(boxes, position_m[flying])
            inside[flying] |= (beyond_m < PENETRATION_M).all(axis=2).any(axis=0)
            gap_m = np.linalg.norm(np.maximum(beyond_m, 0.0), axis=2)
            least_m = min(least_m, float(gap_m.min(initial=np.inf)))
    return int(inside.sum()), least_m


def last_passing_tick(record: FlightRecord) -> int:
    """The last tick at which a vehicle approached a box; 0 without any."""
    return next((tick for tick in range(len(record.time_s) - 1, 0, -1) if approaching(record, tick)), 0)


def approaching(record: FlightRecord, tick: int) -> bool:
    """Whether at that tick a vehicle approached a near box that it must avoid, or a box became known."""
    headroom_m = record.scenario.control.law.avoidance.headroom_m
    step_m = NEARER_M_S / record.scenario.world.tick_rate_hz
    before = {box.id: box for box in record.boxes[tick - 1]}
    boxes = record.boxes[tick]
    if not boxes or any(box.id not in before for box in boxes):
        return bool(boxes)
    here_m = _beyond_m(boxes, record.position_m[tick])
    gap_m = np.hypot(*np.maximum(here_m[:, :, :2], 0.0).transpose(2, 0, 1))
    near = (gap_m < NEAR_M) & (here_m[:, :, 2] < headroom_m)
    if not near.any():
        return False
    there_m = _beyond_m([before[box.id] for box in boxes], record.position_m[tick - 1])
    nearer = np.hypot(*np.maximum(there_m[:, :, :2], 0.0).transpose(2, 0, 1)) - gap_m > step_m
    return bool((nearer & near).any())


def same_side(record: FlightRecord) -> bool:
    """Whether all vehicles that had to avoid the single standing box passed it on the same side."""
    box = record.boxes[-1][0]
    course_m = record.target_m[-1] - record.center_m[0][:2]
    ahead = course_m / max(float(np.linalg.norm(course_m)), 1e-9)
    avoidance = record.scenario.control.law.avoidance
    ellipse = Ellipse.around(box, margin_m=avoidance.margin_m, headroom_m=avoidance.headroom_m)
    start_m = record.position_m[0].astype(np.float64)
    must = _meets(ellipse, start_m, ahead) & (-start_m[:, 2] < ellipse.top_height_m)
    sides = set()
    for row in np.flatnonzero(must):
        offset_m = record.path_m[:, row, :2] - (box.x_m, box.y_m)
        beside = int(np.argmax(offset_m @ ahead > 0.0))
        sides.add(bool(offset_m[beside] @ (-ahead[1], ahead[0]) > 0.0))
    return len(sides) <= 1


def through(record: FlightRecord) -> bool:
    """Whether the formation is at its destination, with all its vehicles on the sphere."""
    center_m, rows = record.center_m[-1], record.formed[-1]
    away_m = abs(float(np.linalg.norm(center_m[:2] - record.target_m[-1])) - record.orbit_radius_m)
    off_m = np.linalg.norm(record.position_m[-1][rows] - center_m, axis=1) - record.radius_m[-1]
    return bool(away_m < THROUGH_M and (np.abs(off_m) < THROUGH_M).all())


def shortest_path_m(record: FlightRecord, clear_m: float) -> float:
    """Length of the centre's shortest level path from start to target past standing boxes grown by `clear_m`.

    As of `shortest_paths_m`, without the code that flies.
    """
    start_m, target_m = record.center_m[0][None, :2], record.target_m[-1][None]
    return float(shortest_paths_m(record.boxes[-1], start_m, target_m, clear_m)[0])


def _meets(ellipse: Ellipse, start_m: Array, ahead: Array) -> Mask:
    """(n,) whether a straight line from each start (n, 3) along `ahead` (2,) crosses the ellipse."""
    point, heading = ellipse.normalised(start_m), ahead / ellipse.semi_m
    along = point @ heading
    outside = (point**2).sum(axis=1) - 1.0
    meets: Mask = (along < 0.0) & (along**2 > outside * (heading @ heading))
    return meets


def _beyond_m(boxes: Sequence[Obstacle], position_m: Array) -> Array:
    """(k, n, 3) distances beyond the faces of k boxes in x and y, and above their tops; negative inside."""
    middle_m = np.array([(box.x_m, box.y_m) for box in boxes])
    half_m = np.array([(box.half_length_x_m, box.half_length_y_m) for box in boxes])
    top_m = np.array([box.height_m for box in boxes])
    level_m = np.abs(position_m[:, :2] - middle_m[:, None]) - half_m[:, None]
    return np.concatenate([level_m, (-position_m[:, 2] - top_m[:, None])[:, :, None]], axis=2)
