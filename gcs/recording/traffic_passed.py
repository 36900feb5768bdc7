"""How near other traffic came, each track by its own estimate. Pure."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.model.state import Mask, VehicleId
from gcs.recording.mcap_reader import RecordedSample
from gcs.service.snapshots import TrackPassed


def traffic_passed(
    ticks: Sequence[RecordedSample],
    ids: Sequence[VehicleId],
    position_m: NDArray[np.float32],
    airborne: Mask,
) -> tuple[TrackPassed, ...]:
    """Of each track, since operators were alarmed of it: which vehicle in the air was nearest, and when.

    Args:
        ticks: of the flight.
        ids: of the n vehicles.
        position_m: (k, n, 3) at each tick.
        airborne: (k, n)
    """
    nearest: dict[str, TrackPassed] = {}
    for at, (before, tick) in enumerate(pairwise(ticks), 1):
        traffic = tick.features.traffic
        rows = np.flatnonzero(airborne[at] & np.isfinite(position_m[at]).all(axis=1))
        if traffic is None or tick.features is before.features or not len(rows):
            continue
        at_s = round(tick.tick.time_s - ticks[0].tick.time_s, 2)
        for track in traffic.nearest:
            closest = nearest.get(track.id)
            if not track.near and closest is None:
                continue
            x_m, y_m, z_m = position_m[at, rows].T
            away_m = np.hypot(x_m - track.x_m, y_m - track.y_m)
            above_m = np.zeros_like(z_m) if track.height_m is None else track.height_m + z_m
            outside_m = np.maximum(away_m - traffic.radius_m, np.abs(above_m) - traffic.half_height_m)
            best = int(outside_m.argmin())
            if closest is None or outside_m[best] < closest.outside_m:
                nearest[track.id] = TrackPassed(
                    track.id,
                    track.kind,
                    ids[rows[best]],
                    round(float(outside_m[best]), 1),
                    round(float(away_m[best]), 1),
                    None if track.height_m is None else round(float(above_m[best]), 1),
                    round(track.deviation_m, 1),
                    at_s,
                )
    return tuple(nearest.values())
