"""Boxes to fly around, as ellipses with a margin (article, section 4.1, corrected), one or many at once.

Everything but the height is computed in the horizontal plane. An affine map turns each ellipse into the unit
circle, where tangents are simple; it keeps tangency, order along a line and sides.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import sqrt
from typing import Annotated

import numpy as np
from pydantic import Field

from gcs.model.jit import kernel
from gcs.model.plan import Obstacle
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import TINY, Array, Mask


class AvoidanceSettings(Settings):
    """Distances and rates of flying around obstacles."""

    margin_m: Positive = 2.0
    """Added to every side of the box for vehicle, position and tracking error, in m."""
    headroom_m: NotNegative = 3.0
    """Vehicles this far above the top need not avoid the box, in m."""
    lookahead_m: Positive = 12.0
    """From this distance the tangent begins to count, in m."""
    near_m: Positive = 3.0
    """From this distance only the tangent counts, and the ellipse pushes, in m."""
    push_rate_per_s: Positive = 0.5
    """Outward push per metre inside `near_m`, in 1/s."""
    lead_out_m_s: Positive = 1.5
    """Limit of the push, and speed at which a vehicle inside is led out, in m/s."""
    center_lookahead_m: Positive = 60.0
    """From this distance the formation's centre goes around, in a wide arc, in m."""
    no_headway_s: Annotated[float, Field(ge=1.0, le=60.0)] = 6.0
    """Without gaining on its goal for so long there is an alarm, in s."""
    climbs: bool = True
    """Whether the centre flies over where no way leads round, if the fence is high enough."""
    center_clearance: NotNegative = 1.0
    """Share of the sphere that its centre leads past; 0: the centre only."""


@dataclass(frozen=True, slots=True)
class Ellipse:
    """The ellipse around a box grown by a margin, at one instant, and its height. Show frame."""

    x_m: float
    y_m: float
    semi_x_m: float
    semi_y_m: float
    top_height_m: float  # vehicles above this height need not avoid it
    velocity_x_m_s: float = 0.0
    velocity_y_m_s: float = 0.0
    beside_slots: bool = False  # slots may lie close to it: it pushes nothing, and is not met beyond a slot

    @staticmethod
    def around(
        obstacle: Obstacle, *, margin_m: float, headroom_m: float, time_s: float | None = None
    ) -> "Ellipse":
        """The tightest ellipse of the article, around the box grown by `margin_m` on every side.

        As printed (semi-axes sqrt(2) times the half-lengths) it passes through the corners; growing the box
        first leaves at least `margin_m` to the box everywhere. A moving box is taken at its position at
        `time_s`, or at its last received position without `time_s`.
        """
        x_m, y_m = obstacle.position_m(obstacle.time_s if time_s is None else time_s)
        return Ellipse(
            x_m,
            y_m,
            sqrt(2.0) * (obstacle.half_length_x_m + margin_m),
            sqrt(2.0) * (obstacle.half_length_y_m + margin_m),
            obstacle.height_m + headroom_m,
            obstacle.velocity_x_m_s,
            obstacle.velocity_y_m_s,
        )

    @property
    def semi_m(self) -> Array:
        """(2,) both semi-axes."""
        return np.array([self.semi_x_m, self.semi_y_m])

    @property
    def velocity_m_s(self) -> Array:
        """(2,)."""
        return np.array([self.velocity_x_m_s, self.velocity_y_m_s])

    def normalised(self, position_m: Array) -> Array:
        """(n, 3) or (n, 2) positions in the plane in which the ellipse is the unit circle, (n, 2)."""
        normalised: Array = (position_m[:, :2] - np.array([self.x_m, self.y_m])) / self.semi_m
        return normalised

    def outward(self, position_m: Array) -> Array:
        """(n, 2) unit normals, away from the ellipse; along x at its centre itself."""
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
        """(n,) True inside the ellipse, whatever the height."""
        inside: Mask = (self.normalised(position_m) ** 2).sum(axis=1) < 1.0
        return inside


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """Many ellipses as arrays, for the compiled loops. Show frame."""

    names: tuple[str, ...]
    center_m: Array  # (m, 2)
    semi_m: Array  # (m, 2)
    velocity_m_s: Array  # (m, 2)
    top_height_m: Array  # (m,)
    beside_slots: Mask  # (m,) as of `Ellipse`

    @staticmethod
    def of(ellipses: Mapping[str, Ellipse]) -> "Outlines":
        return _outlines(tuple(ellipses), tuple(ellipses.values()))

    def __len__(self) -> int:
        return len(self.names)

    @property
    def half_length_m(self) -> Array:
        """(m, 2) half-lengths of the grown boxes, whose corners the ellipses touch."""
        half: Array = self.semi_m / sqrt(2.0)
        return half

    @property
    def stand(self) -> Mask:
        """(m,) True where an ellipse does not move."""
        stand: Mask = (self.velocity_m_s == 0.0).all(axis=1)
        return stand

    def only(self, rows: Mask) -> "Outlines":
        """The ellipses `rows` (m,)."""
        names = tuple(name for name, kept in zip(self.names, rows, strict=True) if kept)
        places = self.center_m[rows], self.semi_m[rows], self.velocity_m_s[rows]
        return Outlines(names, *places, self.top_height_m[rows], self.beside_slots[rows])

    def grown(self, by_m: Array) -> "Outlines":
        """The ellipses with both semi-axes longer by `by_m` (m,)."""
        return replace(self, semi_m=self.semi_m + by_m[:, None])

    def nearest_m(self, position_m: Array) -> Array:
        """(m,) smallest distance of (n, 2 or 3) positions, as `Ellipse.distance_m`; inf without any."""
        nearest: Array = _nearest_m(np.array(position_m[:, :2], order="C"), self.center_m, self.semi_m)
        return nearest


@lru_cache(maxsize=4)
def _outlines(names: tuple[str, ...], ellipses: tuple[Ellipse, ...]) -> Outlines:
    """As `Outlines.of`; cached, because a tick needs them several times, and standing ones do not change."""
    rows = [
        (e.x_m, e.y_m, e.semi_x_m, e.semi_y_m, e.velocity_x_m_s, e.velocity_y_m_s, e.top_height_m)
        for e in ellipses
    ]
    table = np.array(rows, dtype=np.float64).reshape(-1, 7).T.copy()
    pairs = [np.ascontiguousarray(table[k : k + 2].T) for k in (0, 2, 4)]
    beside_slots = np.array([e.beside_slots for e in ellipses], np.bool_)
    return Outlines(names, pairs[0], pairs[1], pairs[2], table[6], beside_slots)


@kernel
def _nearest_m(position_m: Array, center_m: Array, semi_m: Array) -> Array:
    nearest_m = np.full(len(center_m), np.inf)
    for j in range(len(center_m)):
        for i in range(len(position_m)):
            qx = (position_m[i, 0] - center_m[j, 0]) / semi_m[j, 0]
            qy = (position_m[i, 1] - center_m[j, 1]) / semi_m[j, 1]
            radius = np.sqrt(qx * qx + qy * qy)
            slope = np.sqrt((qx / semi_m[j, 0]) ** 2 + (qy / semi_m[j, 1]) ** 2)
            away_m = (radius - 1.0) * radius / slope if radius > TINY else -min(semi_m[j, 0], semi_m[j, 1])
            nearest_m[j] = min(nearest_m[j], away_m)
    return nearest_m
