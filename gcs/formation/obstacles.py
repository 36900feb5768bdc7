"""Smooth avoidance of boxes by the tangents of their enclosing ellipses (article, section 4, corrected).

Everything happens in the horizontal plane, in the frame in which the box's edges lie along the axes. An
affine map turns each ellipse into the unit circle, where tangents are simple; it keeps tangency, order along
a line and sides.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from gcs.formation.sphere import TINY
from gcs.plan import Obstacle
from gcs.settings import NotNegative, Positive, Settings
from gcs.state import Array, Mask

LEFT, RIGHT = -1.0, 1.0
"""Sides on which to pass, as seen by the one who passes; y points right."""


class AvoidanceSettings(Settings):
    """How wide and how early to go around."""

    margin_m: Positive = 2.0  # added to every side of the box: vehicle, position error, tracking error
    headroom_m: NotNegative = 3.0  # this far above the top nobody need avoid
    lookahead_m: Positive = 12.0  # from here on the tangent begins to count
    near_m: Positive = 3.0  # from here on only the tangent counts, and the ellipse pushes
    push_rate_per_s: Positive = 0.5  # of the outward push, per metre inside near_m
    lead_out_m_s: Positive = 1.5  # bound of the push; speed at which one inside is led out


@dataclass(frozen=True, slots=True)
class Ellipse:
    """The ellipse around a box grown by a margin, and how high it reaches. Show frame."""

    x_m: float
    y_m: float
    semi_x_m: float
    semi_y_m: float
    top_height_m: float  # nobody above this need avoid

    @staticmethod
    def around(obstacle: Obstacle, *, margin_m: float, headroom_m: float) -> "Ellipse":
        """The tightest ellipse of the article, around the box grown by `margin_m` on every side.

        As printed (semi-axes sqrt(2) times the half-lengths) it passes through the corners; growing the box
        first leaves at least `margin_m` to the box everywhere.
        """
        return Ellipse(
            obstacle.x_m,
            obstacle.y_m,
            sqrt(2.0) * (obstacle.half_length_x_m + margin_m),
            sqrt(2.0) * (obstacle.half_length_y_m + margin_m),
            obstacle.height_m + headroom_m,
        )

    @property
    def semi_m(self) -> Array:
        """(2,) both semi-axes."""
        return np.array([self.semi_x_m, self.semi_y_m])

    def normalised(self, position_m: Array) -> Array:
        """(n, 3) or (n, 2) positions in the plane in which the ellipse is the unit circle, (n, 2)."""
        normalised: Array = (position_m[:, :2] - np.array([self.x_m, self.y_m])) / self.semi_m
        return normalised

    def outward(self, position_m: Array) -> Array:
        """(n, 2) unit normals, away from the ellipse; along x at its very centre."""
        gradient = self.normalised(position_m) / self.semi_m
        length = np.linalg.norm(gradient, axis=1, keepdims=True)
        return np.where(length > TINY, gradient / np.maximum(length, TINY), (1.0, 0.0))

    def distance_m(self, position_m: Array) -> Array:
        """(n,) distance to the ellipse to first order, negative inside; exact on it and for a circle."""
        point = self.normalised(position_m)
        radius = np.linalg.norm(point, axis=1)
        slope = np.linalg.norm(point / self.semi_m, axis=1)
        distance: Array = np.where(
            radius > TINY,
            (radius - 1.0) * radius / np.maximum(slope, TINY),
            -min(self.semi_x_m, self.semi_y_m),
        )
        return distance

    def contains(self, position_m: Array) -> Mask:
        """(n,) True within the ellipse, whatever the height."""
        inside: Mask = (self.normalised(position_m) ** 2).sum(axis=1) < 1.0
        return inside


def tangent_points_m(ellipse: Ellipse, position_m: Array) -> tuple[Array, Array]:
    """Where the two tangents from each position touch the ellipse: left and right, (n, 2) each.

    Left and right as seen looking from the position towards the ellipse. A position inside is first moved
    out onto the ellipse, where both tangents touch.
    Source: article, section 4.1; the system solved for the unit circle.
    """
    point = ellipse.normalised(position_m)
    radius = np.linalg.norm(point, axis=1, keepdims=True)
    point = np.where(radius > TINY, point, (1.0, 0.0)) * np.maximum(1.0, 1.0 / np.maximum(radius, TINY))
    square = (point**2).sum(axis=1, keepdims=True)
    along = point / square
    across = np.sqrt(np.maximum(square - 1.0, 0.0)) / square * np.stack([-point[:, 1], point[:, 0]], axis=1)
    center_m = np.array([ellipse.x_m, ellipse.y_m])
    return center_m + (along + across) * ellipse.semi_m, center_m + (along - across) * ellipse.semi_m


def tangent_directions(ellipse: Ellipse, position_m: Array) -> tuple[Array, Array]:
    """Unit vectors along the left and the right tangent, pointing ahead, (n, 2) each.

    The article's arctan points backwards and loses the quadrant; these point from the drone to the tangent
    point, and on or inside the ellipse along its contour.
    """
    directions = []
    normal = ellipse.outward(position_m)
    contour = np.stack([-normal[:, 1], normal[:, 0]], axis=1)  # looking inward, this is to the left
    for touch_m, ahead in zip(tangent_points_m(ellipse, position_m), (contour, -contour), strict=True):
        line_m = touch_m - position_m[:, :2]
        length_m = np.linalg.norm(line_m, axis=1, keepdims=True)
        outside = (ellipse.normalised(position_m) ** 2).sum(axis=1, keepdims=True) > 1.0
        usable = outside & (length_m > 1e-6)
        directions.append(np.where(usable, line_m / np.maximum(length_m, TINY), ahead))
    return directions[0], directions[1]


def heads_into(ellipse: Ellipse, position_m: Array, velocity_m_s: Array) -> Mask:
    """(n,) True where going on straight would meet the ellipse: between the two tangents."""
    point = ellipse.normalised(position_m)
    heading = velocity_m_s[:, :2] / ellipse.semi_m
    a = (heading**2).sum(axis=1)
    b = (point * heading).sum(axis=1)
    c = (point**2).sum(axis=1) - 1.0
    meets: Mask = (b < 0.0) & (b * b - a * c > 0.0) & (a > TINY)
    return meets


def choose_side(ellipse: Ellipse, position_m: Array, velocity_m_s: Array) -> float:
    """The side on which the whole formation passes: the tangent that turns its centre least.

    Args:
        ellipse: to pass.
        position_m: (3,) or (2,) of the formation's centre.
        velocity_m_s: likewise, its wanted velocity.

    Returns: LEFT or RIGHT. The article's rule compares wrapped angles and always picks the same tangent;
        its purpose, one side for all, is kept by choosing once for the formation.
    """
    left, right = tangent_directions(ellipse, position_m[None, :])
    gain = float((left[0] - right[0]) @ velocity_m_s[:2])
    return LEFT if gain >= 0.0 else RIGHT


def avoid(
    position_m: Array,
    velocity_m_s: Array,
    ellipse: Ellipse,
    settings: AvoidanceSettings,
    *,
    side: Array,
    sliding_m_s: Array,
) -> Array:
    """Turn the velocities of those who would meet the ellipse along its tangent, and push those near it.

    Args:
        position_m: (n, 3), show frame, z down.
        velocity_m_s: (n, 3), what the law wants.
        ellipse: the obstacle, margin and headroom included.
        settings: distances and rates.
        side: (n,) LEFT, RIGHT, or 0 for whichever tangent loses less of the wanted velocity.
        sliding_m_s: (n,) speed to keep along the tangent even when the wanted velocity points straight at
            the obstacle: that of the formation, so that nobody stays behind; 0 lets one wait there.

    Returns: (n, 3) in m/s; the vertical component is left as it is. Rows well above the box are unchanged.
    Source: article, sections 4.2 and 4.3.
    """
    height_m = -position_m[:, 2]
    concerned = height_m < ellipse.top_height_m
    distance_m = ellipse.distance_m(position_m)
    wanted_m_s = velocity_m_s[:, :2]

    left, right = tangent_directions(ellipse, position_m)
    free_side = np.where((wanted_m_s * (left - right)).sum(axis=1) >= 0.0, LEFT, RIGHT)
    on_left = np.where(side == 0.0, free_side, side) == LEFT
    tangent = np.where(on_left[:, None], left, right)
    speed_m_s = np.maximum((wanted_m_s * tangent).sum(axis=1), sliding_m_s)
    along_m_s = tangent * speed_m_s[:, None]

    reach_m = max(settings.lookahead_m - settings.near_m, TINY)
    weight = np.clip((settings.lookahead_m - distance_m) / reach_m, 0.0, 1.0)
    weight = weight * heads_into(ellipse, position_m, velocity_m_s) * concerned
    turned_m_s = wanted_m_s + weight[:, None] * (along_m_s - wanted_m_s)

    outward = ellipse.outward(position_m)
    push_m_s = np.minimum(settings.push_rate_per_s * np.maximum(settings.near_m - distance_m, 0.0), 1.0)
    push_m_s = push_m_s * settings.lead_out_m_s * concerned
    inward_m_s = np.minimum((turned_m_s * outward).sum(axis=1), 0.0) * (concerned & (distance_m <= 0.0))
    result = velocity_m_s.copy()
    result[:, :2] = turned_m_s + (push_m_s - inward_m_s)[:, None] * outward
    return result
