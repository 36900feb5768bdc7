"""Passing abeam: the plane between two vehicles that hinders them least, and at which both can still stop.

A pair keeps apart as long as some plane lies between both. With n its unit normal, from vehicle j to i, and
h(n) the extent of the floor's ellipsoid along it:

    gap(n) = n . (p_i - p_j) - h(n),    -n . (v_i - v_j) <= the speed that stops within gap(n)

Along the line between both this bounds how fast their distance shrinks, and stops them head to head, however
far abeam they would pass. Any other plane keeps the floor as surely if both brake alike: the ellipsoid is
convex, and the closing speed is bounded along one fixed direction.

A plane counts if both can still stop at it from their measured velocities. The plane of the tick before is
such a one, so there is always one. Decision 0065.
"""

from typing import TypeAlias

import numpy as np

from gcs.model.jit import kernel
from gcs.model.state import TINY, Array
from gcs.safety.constraints import allowed_speed_m_s

PLANES, HALVINGS = 4, 8
"""Planes that are tried between the line and the ellipsoid, and how often the step to the next is halved
then: the plane is not to jump from tick to tick.
"""

NO_STOP_M_S, NO_REST_M_S = 1e3, 1e6
"""By this much a plane is worse at which both cannot stop any more, and one from which both have to part."""

Vector: TypeAlias = tuple[float, float, float]

Plane: TypeAlias = tuple[float, float, Vector]
"""How good it is, the speed in m/s at which both may close in on it, and its normal."""

OFFSET, COURSE, MEASURED, DESIRED, UNSURE, LED, SPARE, STANDS = 0, 3, 6, 9, 12, 13, 14, 15
REACTS, LATER, BRAKES, ESCAPES, PAIR_ROWS = 16, 17, 18, 19, 20
"""Rows of what is known of pairs, as `separation` collects it. Of i relative to j, three rows each: offset,
course that is checked, measured and desired velocity. Squares of uncertainty and wander; spare speed; whether
one of both stands; reaction, lead, deceleration and escape rate of the slower one.
"""


@kernel
def best_plane(k: int, seen: Array, wide_m: float, tall_m: float) -> Plane:
    """The best plane for pair k of `seen` (PAIR_ROWS, ...), and an ellipsoid with these semi-axes.

    Inside of the ellipsoid it is the one along the line between both.
    """
    flat = wide_m / tall_m  # heights times this make the ellipsoid a sphere
    x, y, z = seen[OFFSET, k], seen[OFFSET + 1, k], flat * seen[OFFSET + 2, k]
    apart_m = np.sqrt(x * x + y * y + z * z)
    line = (x / apart_m, y / apart_m, z / apart_m) if apart_m > TINY else (0.0, 0.0, 1.0)
    size = apart_m, wide_m, flat
    best = _plane(k, seen, line, line, 0.0, size)  # along the line
    if apart_m <= wide_m:
        return best
    touching = np.sqrt(1.0 - (wide_m / apart_m) ** 2)
    best = _turned(k, seen, DESIRED, line, touching, size, best)  # past each other, as desired
    if best[0] <= -0.5 * NO_STOP_M_S:  # they cannot stop there: as they move
        best = _turned(k, seen, MEASURED, line, touching, size, best)
    return best


@kernel
def _turned(
    k: int, seen: Array, which: int, line: Vector, touching: float, size: Vector, best: Plane
) -> Plane:
    """The best of the planes that are turned towards where one of these velocities leads past, and of `best`.

    The best of all is one of these: what counts are offset and relative velocity, which span one plane.
    """
    x, y, z = seen[which, k], seen[which + 1, k], size[2] * seen[which + 2, k]
    ahead = x * line[0] + y * line[1] + z * line[2]
    x, y, z = x - ahead * line[0], y - ahead * line[1], z - ahead * line[2]
    past = max(np.sqrt(x * x + y * y + z * z), TINY)
    aside, turned, step = (x / past, y / past, z / past), 0.0, touching / PLANES
    for many in range(1, PLANES + 1):
        tried = _plane(k, seen, line, aside, many * step, size)
        if tried[0] > best[0]:
            best, turned = tried, many * step
    for halving in range(2 * HALVINGS):
        step /= 2.0 if halving % 2 == 0 else 1.0
        turn = turned + (step if halving % 2 == 0 else -step)
        if 0.0 < turn <= touching:
            tried = _plane(k, seen, line, aside, turn, size)
            if tried[0] > best[0]:
                best, turned = tried, turn
    return best


@kernel
def _plane(k: int, seen: Array, line: Vector, aside: Vector, turn: float, size: Vector) -> Plane:
    """The plane whose normal is turned from `line` to `aside`, by the angle with the sine `turn`.

    The vectors are units, where heights are such that the ellipsoid is a sphere; `size` is the distance
    there, the sphere's radius, and the factor of heights.
    """
    (apart_m, wide_m, flat), ahead = size, np.sqrt(1.0 - turn * turn)
    x, y = ahead * line[0] + turn * aside[0], ahead * line[1] + turn * aside[1]
    z = flat * (ahead * line[2] + turn * aside[2])
    long = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / long, y / long, z / long
    closing_m_s = -(x * seen[MEASURED, k] + y * seen[MEASURED + 1, k] + z * seen[MEASURED + 2, k])
    gap_m = (ahead * apart_m - wide_m) / long
    if apart_m > wide_m:
        gap_m = max(gap_m, 0.0)  # of a plane that touches, for rounding: rest keeps it
    gap_m -= seen[LATER, k] * max(closing_m_s, 0.0)
    allowed_m_s = allowed_speed_m_s(gap_m, seen[REACTS, k], seen[BRAKES, k], seen[ESCAPES, k])
    left_m_s = allowed_m_s + x * seen[DESIRED, k] + y * seen[DESIRED + 1, k] + z * seen[DESIRED + 2, k]
    stops_m_s = allowed_m_s - closing_m_s
    worse_m_s = NO_STOP_M_S if allowed_m_s >= 0.0 else NO_REST_M_S
    return left_m_s if stops_m_s >= 0.0 else stops_m_s - worse_m_s, allowed_m_s, (x, y, z)
