"""Passing abeam: the plane between two vehicles that slows them least, and at which both can still stop.

Two vehicles keep apart as long as some plane lies between them. With n its unit normal, from vehicle j to i,
and h(n) the extent of the floor's ellipsoid along it:

    gap(n) = n . (p_i - p_j) - h(n),    -n . (v_i - v_j) <= the speed that stops within gap(n)

Along the line between both this bounds how fast their distance shrinks, and stops them head to head, however
far abeam they would pass. Any other plane keeps the floor as surely if both brake alike: the ellipsoid is
convex, and the closing speed is bounded along one fixed direction.

A plane counts if both can still stop at it from their measured velocities. Vehicles that follow their
setpoints can stop at the plane of the tick before. Decision 0065.
"""

from typing import TypeAlias

import numpy as np

from gcs.model.jit import kernel
from gcs.model.state import TINY
from gcs.safety.constraints import allowed_speed_m_s

PLANES, HALVINGS = 4, 8
"""Planes that are tried between the line and the ellipsoid, and how often the step to the next is halved
then: the plane is not to jump from tick to tick.
"""

NO_STOP_M_S, NO_REST_M_S = 1e3, 1e6
"""By this much a plane is worse at which both cannot stop any more, and one from which both have to part."""

Vector: TypeAlias = tuple[float, float, float]

Stops: TypeAlias = tuple[float, float, float, float]
"""Reaction, lead, deceleration and escape rate, as of `Braking`."""

Motion: TypeAlias = tuple[Vector, Vector, Stops]
"""Desired and measured velocity of i relative to j, and how the slower one stops."""

Plane: TypeAlias = tuple[float, float, Vector]
"""How good it is, the speed in m/s at which both may close in on it, and its normal."""


@kernel
def best_plane(
    offset_m: Vector, desired_m_s: Vector, measured_m_s: Vector, size_m: tuple[float, float], stops: Stops
) -> Plane:
    """The best plane between vehicles i and j. Inside of the ellipsoid, the one along the line between both.

    Args:
        offset_m: of i from j.
        desired_m_s: desired velocity of i relative to j.
        measured_m_s: measured velocity of i relative to j.
        size_m: semi-axes of the ellipsoid, sideways and up.
        stops: how the slower one stops.
    """
    wide_m, flat = size_m[0], size_m[0] / size_m[1]  # heights times `flat` make the ellipsoid a sphere
    x, y, z = offset_m[0], offset_m[1], flat * offset_m[2]
    apart_m = np.sqrt(x * x + y * y + z * z)
    line = (x / apart_m, y / apart_m, z / apart_m) if apart_m > TINY else (0.0, 0.0, 1.0)
    motion, scaled = (desired_m_s, measured_m_s, stops), (apart_m, wide_m, flat)
    best = _plane(motion, line, line, 0.0, scaled)  # along the line
    if apart_m <= wide_m:
        return best
    best = _turned(motion, desired_m_s, line, scaled, best)
    if best[0] <= -0.5 * NO_STOP_M_S:  # they cannot stop there
        best = _turned(motion, measured_m_s, line, scaled, best)
    return best


@kernel
def _turned(motion: Motion, velocity_m_s: Vector, line: Vector, scaled: Vector, best: Plane) -> Plane:
    """The best of the planes turned from `line` to the side that `velocity_m_s` leads to, and of `best`.

    What counts are offset and relative velocity, which span all normals that can be the best.
    """
    apart_m, wide_m, flat = scaled
    x, y, z = velocity_m_s[0], velocity_m_s[1], flat * velocity_m_s[2]
    ahead = x * line[0] + y * line[1] + z * line[2]
    x, y, z = x - ahead * line[0], y - ahead * line[1], z - ahead * line[2]
    past = max(np.sqrt(x * x + y * y + z * z), TINY)
    touching = np.sqrt(1.0 - (wide_m / apart_m) ** 2)
    aside, turned, step = (x / past, y / past, z / past), 0.0, touching / PLANES
    for many in range(1, PLANES + 1):
        tried = _plane(motion, line, aside, many * step, scaled)
        if tried[0] > best[0]:
            best, turned = tried, many * step
    for halving in range(2 * HALVINGS):
        step /= 2.0 if halving % 2 == 0 else 1.0
        turn = turned + (step if halving % 2 == 0 else -step)
        if 0.0 < turn <= touching:
            tried = _plane(motion, line, aside, turn, scaled)
            if tried[0] > best[0]:
                best, turned = tried, turn
    return best


@kernel
def _plane(motion: Motion, line: Vector, aside: Vector, turn: float, scaled: Vector) -> Plane:
    """The plane with a normal turned from `line` to `aside`; `turn` is the sine of the angle.

    The vectors are units, where heights are such that the ellipsoid is a sphere; `scaled` is the distance
    there, the sphere's radius, and the factor of heights.
    """
    desired_m_s, measured_m_s, (reaction_s, lead_s, deceleration_m_s2, escape_rate_per_s) = motion
    (apart_m, wide_m, flat), ahead = scaled, np.sqrt(1.0 - turn * turn)
    x, y = ahead * line[0] + turn * aside[0], ahead * line[1] + turn * aside[1]
    z = flat * (ahead * line[2] + turn * aside[2])
    long = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / long, y / long, z / long
    closing_m_s = -(x * measured_m_s[0] + y * measured_m_s[1] + z * measured_m_s[2])
    gap_m = (ahead * apart_m - wide_m) / long
    if apart_m > wide_m:
        gap_m = max(gap_m, 0.0)  # of a plane that touches, for rounding: rest keeps it
    gap_m -= lead_s * max(closing_m_s, 0.0)
    allowed_m_s = allowed_speed_m_s(gap_m, reaction_s, deceleration_m_s2, escape_rate_per_s)
    left_m_s = allowed_m_s + x * desired_m_s[0] + y * desired_m_s[1] + z * desired_m_s[2]
    stops_m_s = allowed_m_s - closing_m_s
    worse_m_s = NO_STOP_M_S if allowed_m_s >= 0.0 else NO_REST_M_S
    return left_m_s if stops_m_s >= 0.0 else stops_m_s - worse_m_s, allowed_m_s, (x, y, z)
