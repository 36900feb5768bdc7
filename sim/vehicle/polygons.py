"""Areas of a fence by latitude and longitude, as autopilots test them. Pure."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from gcs.sim.vehicle.dynamics import Array


class Area(NamedTuple):
    """One polygon."""

    inclusion: bool
    corners_deg: Array  # (k, 2) latitude, longitude

    def contains(self, at_deg: Sequence[float]) -> bool:
        """By W. R. Franklin's PNPOLY, which PX4 adapts."""
        latitude, longitude = self.corners_deg.T
        before_latitude, before_longitude = np.roll(latitude, 1), np.roll(longitude, 1)
        crosses = (longitude >= at_deg[1]) != (before_longitude >= at_deg[1])
        run = np.where(crosses, before_longitude - longitude, 1.0)
        edge = (before_latitude - latitude) * (at_deg[1] - longitude) / run + latitude
        return bool(np.count_nonzero(crosses & (at_deg[0] <= edge)) % 2)

    def allows(self, at_deg: Sequence[float]) -> bool:
        """Whether a vehicle may be there."""
        return self.contains(at_deg) == self.inclusion


class Fenced(Protocol):
    """One vehicle's fence."""

    in_force: tuple[Area, ...]


def outside(areas: Sequence[Area], at_deg: Sequence[float], *, union: bool = False) -> bool:
    """Whether a vehicle there breaches a fence: every area must hold, or with `union` one inclusion."""
    inclusions = [each.allows(at_deg) for each in areas if each.inclusion]
    kept = any(inclusions) if union and inclusions else all(inclusions)
    return not (kept and all(each.allows(at_deg) for each in areas if not each.inclusion))
