"""Published methods that lead vehicles to goals past each other, in their papers' own words; nothing of ours.

Each computes velocities from positions, velocities and goals, (n, 3) each, m and m/s, and keeps `apart_m`
between any two. A vehicle regards the `NEAREST` others within `NEAR_M`. Where the constraints of a vehicle
contradict each other, all of ORCA's are eased alike.

Of each box a vehicle keeps to its own side of the plane at the box's nearest point, `BOX_M` away, and gives
way alone. Boxes are rows (k, 7): middle x and y, half-lengths in x and y, height, velocity in x and y.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol, TypeVar, cast

import numba
import numpy as np
import pyrvo
from numpy.typing import NDArray

from gcs.model.state import Array

NEAR_M, NEAREST = 15.0, 12
HORIZON_S: Final = 10.0
"""So far ahead velocities keep clear (RVO2-3D's example)."""
PROJECTIONS: Final = 60
"""Most rounds of Dykstra's alternating projections; they end when one changes less than `SETTLED`."""
SETTLED: Final = 1e-6
BOX_M: Final = 2.0
"""As the margin of our own settings. A vehicle inside a box grown by 1 m is counted."""
BOX_HORIZON_S: Final = 2.0
"""So far ahead ORCA's velocities keep clear of boxes: shorter than of vehicles, as its paper has it."""
EASED, BISECTIONS = 0.01, 6
STANDS: Final = 0.1
"""A vehicle with less of the speed that it wants stands in a deadlock."""
RATE_PER_S: Final = 1.0
"""Towards the goal, near it."""


F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """As machine code, when it is first called; kept beside this module."""
    return cast("F", numba.njit(cache=True)(function))


class Method(Protocol):
    def velocity_m_s(
        self, position_m: Array, velocity_m_s: Array, goal_m: Array, speed_m_s: float, boxes: Array
    ) -> Array: ...


def preferred_m_s(position_m: Array, goal_m: Array, speed_m_s: float) -> Array:
    """(n, 3) straight to the goals, no faster than `speed_m_s`."""
    away_m = goal_m - position_m
    far_m = np.linalg.norm(away_m, axis=1, keepdims=True)
    desired: Array = away_m * np.minimum(RATE_PER_S, speed_m_s / np.maximum(far_m, 1e-9))
    return desired


class Straight:
    """No avoidance: every vehicle flies to its goal."""

    def velocity_m_s(
        self, position_m: Array, velocity_m_s: Array, goal_m: Array, speed_m_s: float, boxes: Array
    ) -> Array:
        return preferred_m_s(position_m, goal_m, speed_m_s)


Choice = Callable[[Array, Array, Array, float, float, Array], Array]
"""Velocities from positions, velocities, those desired, greatest speed, least distance of two, and boxes."""


@dataclass(frozen=True, slots=True)
class Memoryless:
    """A method that keeps nothing from one tick to the next: `orca` or `voronoi_cells`."""

    choose: Choice
    apart_m: float

    def velocity_m_s(
        self, position_m: Array, velocity_m_s: Array, goal_m: Array, speed_m_s: float, boxes: Array
    ) -> Array:
        desired_m_s = preferred_m_s(position_m, goal_m, speed_m_s)
        return self.choose(position_m, velocity_m_s, desired_m_s, speed_m_s, self.apart_m, boxes)


class Rvo2:
    """The library of ORCA's authors, in the plane: for flights in which all keep one height."""

    def __init__(self, apart_m: float) -> None:
        self._apart_m, self._simulator = apart_m, cast("Any", None)

    def velocity_m_s(
        self, position_m: Array, velocity_m_s: Array, goal_m: Array, speed_m_s: float, boxes: Array
    ) -> Array:
        desired, rows = preferred_m_s(position_m, goal_m, speed_m_s), range(len(position_m))
        if self._simulator is None:
            self._simulator = pyrvo.RVOSimulator()
            self._simulator.set_time_step(1e-9)  # others move the vehicles
            around = NEAR_M, NEAREST, HORIZON_S, BOX_HORIZON_S, self._apart_m / 2.0, speed_m_s
            self._simulator.set_agent_defaults(*around)
            for row in rows:
                self._simulator.add_agent(tuple(position_m[row, :2].tolist()))
            for x_m, y_m, half_x_m, half_y_m in boxes[:, :4].tolist():  # that stand; corners anticlockwise
                corners = (-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)
                self._simulator.add_obstacle([(x_m + x * half_x_m, y_m + y * half_y_m) for x, y in corners])
            self._simulator.process_obstacles()
        for row in rows:
            self._simulator.set_agent_position(row, tuple(position_m[row, :2].tolist()))
            self._simulator.set_agent_velocity(row, tuple(velocity_m_s[row, :2].tolist()))
            self._simulator.set_agent_pref_velocity(row, tuple(desired[row, :2].tolist()))
        self._simulator.do_step()
        for row in rows:
            desired[row, :2] = self._simulator.get_agent_velocity(row).to_tuple()
        return desired


class Barrier:
    """Wang, Ames, Egerstedt 2017, Safety barrier certificates for collisions-free multirobot systems.

    Decentralised, of second order; its accelerations move a reference velocity. With a consistent
    perturbation against deadlocks: a vehicle that stands before another one turns to the right.
    """

    def __init__(self, apart_m: float, dt_s: float) -> None:
        self._apart_m, self._dt_s = apart_m, dt_s
        self._reference_m_s: Array | None = None

    def velocity_m_s(
        self, position_m: Array, velocity_m_s: Array, goal_m: Array, speed_m_s: float, boxes: Array
    ) -> Array:
        before = self._reference_m_s
        if before is None or len(before) != len(velocity_m_s):  # vehicles were lost
            before = velocity_m_s
        desired = preferred_m_s(position_m, goal_m, speed_m_s)
        change = np.asarray(_barrier(position_m, before, desired, self._apart_m, boxes))
        self._reference_m_s = before + self._dt_s * change
        return self._reference_m_s


@compiled
def _nearest(position_m: Array, i: int) -> NDArray[np.int64]:
    """Rows of the `NEAREST` others within `NEAR_M`, the nearest first."""
    rows, square_m2, count = np.empty(NEAREST, np.int64), np.empty(NEAREST), 0
    x, y, z = position_m[i]
    for j in range(len(position_m)):
        dx, dy, dz = position_m[j, 0] - x, position_m[j, 1] - y, position_m[j, 2] - z
        square = dx * dx + dy * dy + dz * dz
        if j == i or square > NEAR_M**2 or (count == NEAREST and square >= square_m2[-1]):
            continue
        count = min(count + 1, NEAREST)
        place = count - 1
        while place > 0 and square_m2[place - 1] > square:
            rows[place], square_m2[place] = rows[place - 1], square_m2[place - 1]
            place -= 1
        rows[place], square_m2[place] = j, square
    return rows[:count]


@compiled
def _facing(here_m: Array, box: Array) -> tuple[Array, float, float]:
    """(3,) unit vector away from a box, (7,) of `boxes`; the distance; the box's speed along it."""
    away_m = np.zeros(3)
    for axis in range(2):
        low_m, high_m = box[axis] - box[2 + axis], box[axis] + box[2 + axis]
        away_m[axis] = here_m[axis] - min(max(here_m[axis], low_m), high_m)
    away_m[2] = min(here_m[2] + box[4], 0.0)  # z is down
    far_m = np.sqrt((away_m**2).sum())
    if far_m < 1e-6:  # inside
        away_m[:2] = here_m[:2] - box[:2]
    unit = away_m / max(np.sqrt((away_m**2).sum()), 1e-9)
    return unit, far_m, unit[0] * box[5] + unit[1] * box[6]


@compiled
def _projected(desired: Array, normal: Array, offset: Array, most: float) -> Array:
    """The point nearest to `desired` (3,) with ``normal @ x >= offset`` (k,) and ``|x| <= most``."""
    count = len(offset)
    correction, point, moved = np.zeros((count + 1, 3)), desired.copy(), np.empty(3)
    for _ in range(PROJECTIONS):
        change = 0.0
        for k in range(count + 1):
            lack, square = 0.0, 0.0
            for c in range(3):
                moved[c] = point[c] + correction[k, c]
                square += moved[c] * moved[c]
                if k < count:
                    lack -= normal[k, c] * moved[c]
            lack = max(lack + offset[k], 0.0) if k < count else 0.0
            scale = min(1.0, most / max(np.sqrt(square), 1e-9)) if k == count else 1.0
            for c in range(3):
                after = scale * moved[c] + (lack * normal[k, c] if k < count else 0.0)
                change = max(change, abs(after - point[c]))
                correction[k, c], point[c] = moved[c] - after, after
        if change < SETTLED:
            break
    return point


@compiled
def _lack(point: Array, normal: Array, offset: Array) -> float:
    """By how much the point is outside of the constraint that it breaks most."""
    most = 0.0
    for k in range(len(offset)):
        most = max(most, offset[k] - (normal[k] * point).sum())
    return most


@compiled
def _least_broken(desired: Array, normal: Array, offset: Array, most: float) -> Array:
    """As `_projected`; constraints that contradict each other are all eased by the least that is needed."""
    point = _projected(desired, normal, offset, most)
    eased = _lack(point, normal, offset)
    if eased < EASED:
        return point
    kept = 0.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (kept + eased)
        tried = _projected(desired, normal, offset - middle, most)
        if _lack(tried, normal, offset - middle) < EASED:
            point, eased = tried, middle
        else:
            kept = middle
    return point


@compiled
def orca(
    position_m: Array, velocity_m_s: Array, desired_m_s: Array, speed_m_s: float, apart_m: float, boxes: Array
) -> Array:
    """van den Berg, Guy, Lin, Manocha 2011, Reciprocal n-body collision avoidance, in three dimensions."""
    result = np.empty_like(desired_m_s)
    for i in range(len(position_m)):
        others = _nearest(position_m, i)
        count = len(others)
        normal, offset = np.empty((count + len(boxes), 3)), np.empty(count + len(boxes))
        for k in range(count):
            away_m = position_m[others[k]] - position_m[i]
            closing = velocity_m_s[i] - velocity_m_s[others[k]]
            far_m2 = (away_m**2).sum()
            horizon_s = HORIZON_S if far_m2 > apart_m**2 else 0.05  # already too near: apart at once
            off = closing - away_m / horizon_s
            ahead = off @ away_m
            if far_m2 > apart_m**2 and not (ahead < 0.0 and ahead**2 > apart_m**2 * (off**2).sum()):
                # on the side of the cone: its point nearest to the closing velocity
                b, c = away_m @ closing, (closing**2).sum()
                crossed = np.cross(away_m, closing)
                root = b * b - far_m2 * (c - (crossed**2).sum() / (far_m2 - apart_m**2))
                scale = (b + np.sqrt(max(root, 0.0))) / far_m2
                off, reach = closing - scale * away_m, apart_m * scale
            else:
                reach = apart_m / horizon_s
            length = max(np.sqrt((off**2).sum()), 1e-9)
            normal[k] = off / length
            offset[k] = normal[k] @ (velocity_m_s[i] + 0.5 * (reach - length) * normal[k])
        for k in range(len(boxes)):
            normal[count + k], far_m, towards_m_s = _facing(position_m[i], boxes[k])
            offset[count + k] = towards_m_s - (far_m - BOX_M) / BOX_HORIZON_S
        result[i] = _least_broken(desired_m_s[i], normal, offset, speed_m_s)
    return result


@compiled
def voronoi_cells(
    position_m: Array, velocity_m_s: Array, desired_m_s: Array, speed_m_s: float, apart_m: float, boxes: Array
) -> Array:
    """Zhou, Wang, Bandyopadhyay, Schwager 2017, Fast, on-line collision avoidance, by buffered Voronoi cells.

    With the paper's rule against deadlocks: a vehicle that stands before another one passes it on the right.
    """
    result = np.empty_like(desired_m_s)
    for i in range(len(position_m)):
        others = _nearest(position_m, i)
        count = len(others)
        normal, offset = np.empty((count + len(boxes), 3)), np.empty(count + len(boxes))
        for k in range(count):
            away_m = position_m[others[k]] - position_m[i]
            far_m = max(np.sqrt((away_m**2).sum()), 1e-9)
            normal[k] = -away_m / far_m
            offset[k] = (
                -RATE_PER_S * (far_m - apart_m) / 2.0
            )  # the cell, shrunk by half of the least distance
        for k in range(len(boxes)):
            normal[count + k], far_m, towards_m_s = _facing(position_m[i], boxes[k])
            offset[count + k] = towards_m_s - RATE_PER_S * (far_m - BOX_M)
        inside = _projected(desired_m_s[i], normal, offset, speed_m_s)
        if np.sqrt((inside**2).sum()) < STANDS * np.sqrt((desired_m_s[i] ** 2).sum()):
            right = np.array([-desired_m_s[i, 1], desired_m_s[i, 0], 0.0])  # x ahead, y right, z down
            inside = _projected(right + 0.3 * desired_m_s[i], normal, offset, speed_m_s)
        result[i] = inside
    return result


ACCELERATION_M_S2, BARRIER_RATE, ANSWER_S = 2.0, 1.0, 0.5


@compiled
def _barrier(
    position_m: Array, velocity_m_s: Array, desired_m_s: Array, apart_m: float, boxes: Array
) -> Array:
    result = np.empty_like(desired_m_s)
    both = 2.0 * ACCELERATION_M_S2
    for i in range(len(position_m)):
        others = _nearest(position_m, i)
        count = len(others)
        normal, offset = np.empty((count + len(boxes), 3)), np.empty(count + len(boxes))
        for k in range(count):
            from_m = position_m[i] - position_m[others[k]]
            closing = velocity_m_s[i] - velocity_m_s[others[k]]
            far_m = max(np.sqrt((from_m**2).sum()), 1e-9)
            along, room_m = (from_m @ closing) / far_m, max(far_m - apart_m, 1e-3)
            barrier = np.sqrt(2.0 * both * room_m) + along
            bound = BARRIER_RATE * barrier**3 * far_m - along**2 + (closing**2).sum()
            bound += both * along * far_m / np.sqrt(2.0 * both * room_m)
            normal[k] = from_m / far_m
            offset[k] = -0.5 * bound / far_m
        for k in range(len(boxes)):
            normal[count + k], far_m, towards_m_s = _facing(position_m[i], boxes[k])
            along = velocity_m_s[i] @ normal[count + k] - towards_m_s
            root = np.sqrt(2.0 * ACCELERATION_M_S2 * max(far_m - BOX_M, 1e-3))
            offset[count + k] = -BARRIER_RATE * (root + along) ** 3 - ACCELERATION_M_S2 * along / root
        goal_m_s = desired_m_s[i]
        if len(others) and np.sqrt((velocity_m_s[i] ** 2).sum()) < STANDS * np.sqrt((goal_m_s**2).sum()):
            goal_m_s = goal_m_s + np.array([-goal_m_s[1], goal_m_s[0], 0.0])
        desired = (goal_m_s - velocity_m_s[i]) / ANSWER_S
        result[i] = _projected(desired, normal, offset, ACCELERATION_M_S2)
    return result
