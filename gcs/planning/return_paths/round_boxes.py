"""Ways of one vehicle home, round obstacles or over them, where no straight path is free (decision 0064)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.formation.obstacles import Ellipse, Outlines
from gcs.formation.ways_round import passes, way_round
from gcs.model.state import TINY, Array
from gcs.planning.return_paths.within_areas import cross_edges, way_within
from gcs.safety.fenced_areas import FencedArea

OFF_EDGES_M: Final = 1.0
"""From the edges of the fence's areas; a vehicle that cuts a corner comes nearer."""

SPARES: Final = ((1.0, 1.0), (3.5, 2.0), (7.0, 1.5))
"""What a way keeps beyond the least clearance, in metres: a vehicle cuts its corners, the more the faster it
is. And how much later than the vehicle can be there a box that moves counts, as a factor: it goes on while
the vehicle passes, and another factor may lead round the other side.
"""

HEIGHTS: Final = (1.0, 0.67, 0.33, 0.0)
"""At which a way round is flown: shares between the least height above the pads and the vehicle's own."""

OVER_M: Final = (1.0, 4.0, 7.0, 10.0)
"""Above the highest obstacle on the straight way, as far as the fence allows."""

AHEAD_S: Final = 30.0
"""No box is taken to be farther on than after this time."""

WAYS: Final = len(SPARES) * len(HEIGHTS) + len(OVER_M)


def _wider_m(start_m: Array, corner_m: Array, goal_m: Array, by_m: float) -> Array:
    """(k, 2) the corners of a way from (2,) to (2,), each `by_m` farther out of the turn that it is."""
    places_m = np.vstack([start_m, corner_m, goal_m])
    legs_m = np.diff(places_m, axis=0)
    along = legs_m / np.maximum(np.linalg.norm(legs_m, axis=1, keepdims=True), TINY)
    outward = along[:-1] - along[1:]
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), TINY)
    wider_m: Array = corner_m + by_m * outward
    return wider_m


@dataclass(frozen=True, eq=False)
class WaysRound:
    """The obstacles at one time.

    Attributes:
        ellipses: with their margins.
        clear_m: what every path keeps from them.
        within_m: distance over the ground to which the fence allows flight.
        highest_m: height to which it allows flight.
        speed_m_s: of the vehicles: a box that moves counts where it will be when one can be there.
        areas: of the fence, within which ways stay.
        ground: the controlled ground, and what is kept from its edges at the least height; None: none.
    """

    ellipses: Sequence[Ellipse]
    clear_m: float
    within_m: float
    highest_m: float
    speed_m_s: float
    areas: Sequence[FencedArea] = ()
    ground: tuple[FencedArea, float] | None = None

    @property
    def move(self) -> bool:
        """Whether an obstacle does."""
        return any(each.velocity_x_m_s or each.velocity_y_m_s for each in self.ellipses)

    def lead(self, start_m: Array, above_m: Array) -> Array:
        """(WAYS, k, 3) places to fly to one after the other, the last is above the pad.

        Rows are filled from the front with the start.

        Args:
            start_m: (3,) where the vehicle hovers, show frame.
            above_m: (3,) above its pad, at the least height.
        """
        outlines = Outlines.of({str(at): each for at, each in enumerate(self.ellipses)})
        one_m, other_m = start_m[:2].copy(), above_m[:2].copy()
        away_m = np.linalg.norm(outlines.center_m - one_m, axis=1)
        there_s = np.minimum(away_m / self.speed_m_s, AHEAD_S)
        center_m = np.array(outlines.center_m)
        lowest_z_m, own_z_m, ways_m = float(above_m[2]), float(min(start_m[2], above_m[2])), list[Array]()
        for at, (spare_m, later) in enumerate(SPARES):
            semi_m = outlines.semi_m + self.clear_m + spare_m
            moved_m = center_m + later * there_s[:, None] * outlines.velocity_m_s
            if (self.areas or self.ground) and (at == 0 or not self.ellipses):
                level_m = way_within(self.areas, one_m, other_m, OFF_EDGES_M + 0.5 * spare_m, self.ground)
            else:
                level_m, is_way = way_round(one_m, other_m, moved_m, semi_m, self.within_m)
                if not is_way and at:  # it begins within what so wide a way keeps
                    semi_m = outlines.semi_m + self.clear_m + SPARES[0][0]
                    level_m, _ = way_round(one_m, other_m, moved_m, semi_m, self.within_m)
                    level_m = _wider_m(one_m, level_m, other_m, spare_m - SPARES[0][0])
            for share in HEIGHTS:
                z_m = np.full(len(level_m) + 1, lowest_z_m + share * (own_z_m - lowest_z_m))
                ways_m.append(np.column_stack([np.vstack([level_m, other_m]), z_m]))
        grown_m = outlines.semi_m + self.clear_m
        met = [not passes(one_m, other_m, center_m[at], grown_m[at]) for at in range(len(outlines))]
        top_m = float(outlines.top_height_m[met].max(initial=-own_z_m))
        top_m = max([top_m, *self._tops_m(start_m, above_m)])
        for more_m in OVER_M:
            over_z_m = min(own_z_m, -min(top_m + more_m, self.highest_m))
            ways_m.append(np.array([[*one_m, over_z_m], [*other_m, over_z_m]]))
        longest = max(map(len, ways_m))
        return np.stack([np.vstack([np.tile(start_m, (longest - len(way), 1)), way]) for way in ways_m])

    def _tops_m(self, start_m: Array, above_m: Array) -> list[float]:
        """The tops of closed spaces that the straight way over the ground passes."""
        return [
            area.height_max_m
            for area in self.areas
            if area.height_max_m is not None
            and not area.inside
            and cross_edges((area,), start_m[None], above_m[None])[0]
        ]
