"""True positions of the vehicles, as JSON Lines for reports and tests. No autopilot reads them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from gcs.sim.fleet import Fleet

PERIOD_S = 0.05


class GroundTruthFile:
    """Writes one line per sample, and flushes it: killed at any moment, at most one line is lost."""

    def __init__(self, file: TextIO) -> None:
        """Write to an open text file, which the caller closes."""
        self._file = file
        self._next_s = 0.0

    def offer(self, fleet: Fleet, time_s: float) -> None:
        """Write a line if one is due at time_s (CLOCK_MONOTONIC)."""
        if time_s < self._next_s:
            return
        late = time_s - self._next_s > PERIOD_S
        self._next_s = (time_s if late else self._next_s) + PERIOD_S
        self._file.write(json.dumps(sample(fleet, time_s), separators=(",", ":")) + "\n")
        self._file.flush()


def sample(fleet: Fleet, time_s: float) -> dict[str, object]:
    """The true state of every vehicle; north, east, down from the fleet's origin."""
    rows = zip(
        fleet.autopilots,
        fleet.bodies.position_m.tolist(),
        fleet.bodies.velocity_m_s.tolist(),
        fleet.geodetic(fleet.bodies.position_m).tolist(),
        strict=True,
    )
    return {
        "time_s": round(time_s, 6),
        "vehicles": [
            {
                "vehicle": fleet.settings.first + autopilot.row + 1,
                "system_id": autopilot.system_id,
                "north_m": round(north_m, 4),
                "east_m": round(east_m, 4),
                "down_m": round(down_m, 4),
                "velocity_north_m_s": round(velocity[0], 4),
                "velocity_east_m_s": round(velocity[1], 4),
                "velocity_down_m_s": round(velocity[2], 4),
                "latitude_deg": round(place[0], 9),
                "longitude_deg": round(place[1], 9),
                "altitude_amsl_m": round(place[2], 4),
                "armed": autopilot.commander.armed,
                "landed": autopilot.commander.landed,
                "mode": autopilot.commander.mode.name,
            }
            for autopilot, (north_m, east_m, down_m), velocity, place in rows
        ],
    }
