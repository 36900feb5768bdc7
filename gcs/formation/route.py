"""Routes of the formation's centre past standing and moving boxes, in space and time.

Every box is grown by the sphere and its margins to a dodecagon, and moves on with its velocity. A route leads
from corner to corner of these, each corner at its place at the time of arrival: the accessibility
graph of Fujimura and Samet, "Planning a time-minimal motion among moving obstacles" (Algorithmica 10, 1993),
of which only tangents are looked at: no earliest route turns away from the box at the corner that it passes.
Where a moving box will pass over the goal, the route waits beside a corner until the goal stays free.
"""

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from gcs.formation.obstacles import Ellipse, Outlines
from gcs.formation.route_search import (
    CORNERS,
    FACING_X,
    FACING_Y,
    HORIZON_S,
    Mover,
    alone_until_s,
    covered,
    grown_boxes,
    inside_s,
    is_blocked,
    last_leg,
    meeting_s,
    out_of,
    refuge,
    search,
)
from gcs.model.state import Array, Mask

SPARE_M = 0.3
"""Corners of a route lie this far outside the grown boxes."""

SIDE_PLACES, MOST_PLACES = 9, 1_000
"""Places looked at on each side of a grown box, and on all of them: a bound of the work."""


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Boxes as the centre's route knows them: grown by sphere and margins. Show frame, now.

    A box grown by a disc has round corners. A dodecagon around it keeps the sides, and has three corners
    where the box has one: round a single mast it is 2 % longer than the arc.
    """

    names: tuple[str, ...]
    place: Array  # (m, 4): centre x and y, velocity x and y
    half_m: Array  # (m, 6) half-widths in the directions of the sides
    first_m: Array  # (m, 6) for the way from where the centre is: no farther than to itself
    corners: Array  # (12 m, 4): place and velocity of each corner, `SPARE_M` outside

    @staticmethod
    def grown(
        outlines: Outlines,
        by_m: Array,
        center_m: Array,
        *,
        as_ellipse: Mask | None = None,
        strict: bool = False,
    ) -> "Boxes":
        """The boxes of these outlines grown by `by_m` (m,), as seen by a centre at (2,).

        Those `as_ellipse` (m,) are as large as the ellipses that vehicles fly round. A centre inside a grown
        box may leave it, but not go deeper; `strict`: it has no way out.
        """
        place = np.hstack([outlines.center_m, outlines.velocity_m_s])
        round_ = np.zeros(len(outlines), np.bool_) if as_ellipse is None else as_ellipse
        half_m, corners = grown_boxes(place, outlines.half_length_m, by_m, round_, SPARE_M)
        first_m = half_m if strict else out_of(place, half_m, center_m)
        return Boxes(outlines.names, place, half_m, first_m, corners)

    def numbers(self, corners: tuple[tuple[str, int], ...]) -> tuple[int, ...]:
        """The numbers of those of the corners, by name and number at the box, that are known here."""
        return tuple(CORNERS * self.names.index(name) + k for name, k in corners if name in self.names)

    def corner_m(self, corner: int, time_s: float) -> Array:
        """(2,) place of a corner after `time_s`."""
        place_m: Array = self.corners[corner, :2] + time_s * self.corners[corner, 2:]
        return place_m

    def velocity_m_s(self, corner: int) -> Array:
        """(2,) of the corner's box."""
        velocity: Array = self.corners[corner, 2:]
        return velocity

    def hold(self, places_m: Array, time_s: Array) -> Mask:
        """(k,) whether any grown box is over the places (k, 2) after `time_s` (k,)."""
        away_m = places_m[:, None] - self.place[:, :2] - time_s[:, None, None] * self.place[:, 2:]
        facing = np.column_stack([FACING_X, FACING_Y])[: self.half_m.shape[1]]
        outside_m: Array = (np.abs(away_m @ facing.T) - self.half_m).max(axis=2)
        return np.asarray((outside_m < 0.0).any(axis=1))

    def free_places(self, near_m: Array, velocity_m_s: Array, reach_m: float) -> tuple[Array, Array]:
        """Places outside all grown boxes, along their sides: (k, 2), and the velocity (k, 2) of each.

        From the nearest to a point at (2,) to the farthest. The boxes count as they lie now; a place goes on
        along its side as the point goes with (2,). No place is farther than `reach_m` from the show's origin.
        """
        ends_m, boxes = self.corners[:, :2].reshape(-1, CORNERS, 2), len(self.place)
        begin_m = np.roll(ends_m, 1, axis=1).reshape(-1, 1, 2)
        along_m = ends_m.reshape(-1, 1, 2) - begin_m
        length_m = np.maximum(np.linalg.norm(along_m, axis=2, keepdims=True), 1e-9)
        beside = ((near_m - begin_m) * along_m).sum(axis=2, keepdims=True) / length_m**2
        shares = np.broadcast_to(
            np.linspace(0.0, 1.0, SIDE_PLACES)[None, :, None], (len(begin_m), SIDE_PLACES, 1)
        )
        shares = np.concatenate([shares, np.clip(beside, 0.0, 1.0)], axis=1)
        places_m = (begin_m + shares * along_m).reshape(-1, 2)
        of_box = np.repeat(np.arange(boxes), CORNERS * (SIDE_PLACES + 1))
        side = np.repeat((along_m / length_m)[:, 0], SIDE_PLACES + 1, axis=0)
        box_m_s = self.place[of_box, 2:]
        slides_m_s = ((velocity_m_s - box_m_s) * side).sum(axis=1, keepdims=True)
        inner = (shares > 0.0) & (shares < 1.0)
        goes_m_s = box_m_s + np.where(inner.reshape(-1, 1), slides_m_s, 0.0) * side
        inside = np.hypot(*places_m.T) <= reach_m
        order = np.argsort(np.hypot(*(places_m - near_m).T), kind="stable")
        order = order[inside[order]][:MOST_PLACES]
        order = order[~self.hold(places_m[order], np.zeros(len(order)))]
        return places_m[order], goes_m_s[order]

    def later(self, by_s: float, center_m: Array) -> "Boxes":
        """The boxes after `by_s`, as a centre at (2,) sees them."""
        place, corners = self.place.copy(), self.corners.copy()
        place[:, :2] += by_s * place[:, 2:]
        corners[:, :2] += by_s * corners[:, 2:]
        return replace(self, place=place, corners=corners, first_m=out_of(place, self.half_m, center_m))


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """Where a route leads: a place over the ground that may move."""

    place_m: Array  # (2,) now
    velocity_m_s: Array  # (2,)
    stay_s: float = HORIZON_S  # time for which it must stay free after the arrival
    held_by: str = ""  # the obstacle that keeps the sphere from where the plan leads: this is instead of it
    flees: bool = False  # from obstacles that move

    def later(self, by_s: float) -> "Goal":
        """The goal after `by_s`."""
        return replace(self, place_m=self.place_m + by_s * self.velocity_m_s)

    @property
    def mover(self) -> Mover:
        """Place and velocity for the kernels."""
        return (*_pair(self.place_m), *_pair(self.velocity_m_s))


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Corners to pass in their order, then the goal."""

    corners: tuple[int, ...]
    arrival_s: tuple[float, ...]  # from now, at each corner and at the end
    reaches: bool  # False: it ends at its last corner, or where the centre is, as near as it can
    leaves_s: float = 0.0  # departure from the last corner to the goal


def find_route(boxes: Boxes, center_m: Array, goal: Goal, speed_m_s: float, reach_m: float) -> Route:
    """The earliest route of a centre at (2,) to the goal, or to the nearest refuge where there is none.

    Args:
        boxes: grown by the sphere.
        center_m: show frame.
        goal: where it leads.
        speed_m_s: over the ground, on every leg.
        reach_m: no corner farther from the show's origin is used.
    """
    start, mover = _pair(center_m), goal.mover
    key = (boxes.place, boxes.half_m, boxes.first_m, boxes.corners, start, mover)
    arrival_s, before, last, leaves_s, there_s = search(*key, goal.stay_s, speed_m_s, reach_m)
    reaches = last > -2
    at = int(last) if reaches else int(refuge(*key, arrival_s))
    corners: list[int] = []
    while at >= 0:
        corners.insert(0, at)
        at = int(before[at])
    times_s = [float(arrival_s[corner]) for corner in corners]
    if reaches:
        times_s.append(float(there_s))
    return Route(tuple(corners), tuple(times_s), reaches, float(leaves_s) if reaches else 0.0)


def timed(
    boxes: Boxes, center_m: Array, corners: tuple[int, ...], goal: Goal, speed_m_s: float
) -> Route | None:
    """The route over these corners to the goal as flown from (2,) now; None where a box is in its way."""
    here_m, now_s, times_s = center_m[:2], 0.0, []
    for k, corner in enumerate(corners):
        fly_s = _leg_s(boxes, here_m, corner, now_s, speed_m_s, first=k == 0)
        if fly_s == inf:
            return None
        now_s += fly_s
        here_m = boxes.corner_m(corner, now_s)
        times_s.append(now_s)
    mover = (*_pair(here_m), *(_pair(boxes.velocity_m_s(corners[-1])) if corners else (0.0, 0.0)))
    leaves_s, there_s = _to_goal(boxes, mover, now_s, goal, speed_m_s, HORIZON_S, first=not corners)
    return None if there_s == inf else Route(corners, (*times_s, there_s), reaches=True, leaves_s=leaves_s)


def next_leg(
    boxes: Boxes, center_m: Array, corners: tuple[int, ...], goal: Goal, speed_m_s: float, *, reaches: bool
) -> tuple[tuple[int, ...], Array] | None:
    """The corners still to pass, and the (2,) velocity of the first leg; None where no leg is free.

    Without corners the velocity leads to the goal, or is 0 where the route does not reach it.
    """
    if reaches and leaves_now(boxes, center_m, goal, speed_m_s):
        gap_m = goal.place_m - center_m[:2]
        fly_s = max(meeting_s(*_pair(gap_m), *_pair(goal.velocity_m_s), speed_m_s), 1e-3)
        return (), gap_m / fly_s + goal.velocity_m_s
    if not corners:
        return None if reaches else ((), np.zeros(2))
    for k in range(len(corners) - 1, -1, -1):
        fly_s = _leg_s(boxes, center_m, corners[k], 0.0, speed_m_s, first=True)
        if fly_s < inf:
            along_m_s = boxes.velocity_m_s(corners[k])
            if fly_s > 1e-3:
                along_m_s = (boxes.corner_m(corners[k], fly_s) - center_m[:2]) / fly_s
            return corners[k:], along_m_s
    return None


def leaves_now(boxes: Boxes, center_m: Array, goal: Goal, speed_m_s: float) -> bool:
    """Whether the straight way to the goal is free now, and the goal then stays free."""
    mover = (*_pair(center_m), 0.0, 0.0)
    return _to_goal(boxes, mover, 0.0, goal, speed_m_s, 0.0, first=True)[0] == 0.0


def in_the_way(boxes: Boxes, center_m: Array, goal: Goal, speed_m_s: float) -> str:
    """The first box on the straight way to the goal, or one that covers it; "" for none."""
    gap_m = goal.place_m - center_m[:2]
    fly_s = float(np.hypot(*gap_m)) / speed_m_s
    mover = (*_pair(center_m), *_pair(gap_m / max(fly_s, 1e-9)))
    for half_m, way, to_s in ((boxes.first_m, mover, fly_s), (boxes.half_m, goal.mover, HORIZON_S)):
        spans_s = [inside_s(boxes.place, half_m, j, way, 0.0) for j in range(len(boxes.place))]
        blocking = [
            (enter_s, j)
            for j, (enter_s, leave_s) in enumerate(spans_s)
            if leave_s > 1e-6 and enter_s < to_s - 1e-6
        ]
        if blocking:
            return boxes.names[min(blocking)[1]]
    return ""


def stays_free(boxes: Boxes, center_m: Array, for_s: float) -> bool:
    """Whether no grown box comes over a centre that stays at (2,)."""
    here = (*_pair(center_m), 0.0, 0.0)
    return bool(alone_until_s(boxes.place, boxes.first_m, here, 0.0) >= for_s)


def free_until_s(boxes: Boxes, place_m: Array) -> float:
    """For how long no grown box comes over a place (2,); infinity for ever."""
    return float(alone_until_s(boxes.place, boxes.half_m, (*_pair(place_m), 0.0, 0.0), 0.0))


def _to_goal(
    boxes: Boxes, mover: Mover, at_s: float, goal: Goal, speed_m_s: float, latest_s: float, *, first: bool
) -> tuple[float, float]:
    half_m = boxes.first_m if first else boxes.half_m
    covered_s = covered(boxes.place, boxes.half_m, goal.mover)
    key = (boxes.place, half_m, covered_s, mover, at_s, goal.mover)
    leaves_s, there_s = last_leg(*key, goal.stay_s, speed_m_s, latest_s)
    return float(leaves_s), float(there_s)


def _leg_s(
    boxes: Boxes, here_m: Array, corner: int, from_s: float, speed_m_s: float, *, first: bool
) -> float:
    """After how long a corner is met; infinity when a box is in the way."""
    gap_m, velocity_m_s = boxes.corner_m(corner, from_s) - here_m[:2], boxes.velocity_m_s(corner)
    fly_s = float(meeting_s(*_pair(gap_m), *_pair(velocity_m_s), speed_m_s))
    if 1e-6 < fly_s < inf:
        leg = (*_pair(here_m), *_pair(gap_m / fly_s + velocity_m_s))
        if is_blocked(boxes.place, boxes.first_m if first else boxes.half_m, leg, from_s, from_s + fly_s):
            return inf
    return fly_s


def _pair(vector: Array) -> tuple[float, float]:
    return float(vector[0]), float(vector[1])


def warm_up() -> None:
    """Compile or load every kernel that a route needs."""
    outlines = Outlines.of({"wall": Ellipse(20.0, 0.0, 7.0, 7.0, 1.0)})
    boxes, here_m = Boxes.grown(outlines, np.zeros(1), np.zeros(2)), np.zeros(2)
    for goal in (Goal(np.array([40.0, 0.0]), here_m), Goal(np.array([20.0, 0.0]), here_m)):
        route = find_route(boxes, here_m, goal, 2.0, 100.0)
        timed(boxes, here_m, route.corners, goal, 2.0)
        next_leg(boxes, here_m, route.corners, goal, 2.0, reaches=route.reaches)
        in_the_way(boxes, here_m, goal, 2.0)
    stays_free(boxes, here_m, 1.0)
