"""Inputs of the preflight checks, as known at one time."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gcs.config.sections import PreflightSettings
from gcs.estimation.position_uncertainty import Positioning
from gcs.model.state import Array, FleetState, Telemetry, VehicleId
from gcs.safety.separation import Floor
from gcs.safety.walls import Fence


@dataclass(frozen=True, slots=True, eq=False)
class PreflightInputs:
    """Inputs for the whole fleet. Rows as in FleetState."""

    fleet: FleetState
    rows: Mapping[VehicleId, int]  # of FleetState
    telemetry: Mapping[VehicleId, tuple[Telemetry, int]]  # its link's, and its row there
    conflicts: Mapping[VehicleId, str]  # system ids received from two addresses
    uncertainty_m: Array  # (n,) of each position, as reported
    age_max_s: float  # of a position
    floor: Floor  # pads closer than minimum separation and margin would violate it on the way up
    fence: Fence  # pads beyond its distance are not at the show's site
    positioning: Positioning  # limits of reported accuracy
    settings: PreflightSettings
    roomy: frozenset[VehicleId] = frozenset()  # vehicles with enough room to wander at the last check
    pads_within_m: float = np.inf  # of the origin; the autopilots' own fences are wide enough for no others
    battery_need: float | None = 0.0  # of a selected show, share of a full battery; None: not known
    speed_need_m_s: float = 0.0  # of a selected show, sideways
    speed_max_m_s: Array | None = None  # (n,) that a vehicle is configured for
    ahead_s: float = 0.0  # our Unix time minus the loop's clock

    def is_placed(self, row: int) -> bool:
        """Whether its position is fresh, so that it can be checked."""
        return bool(self.fleet.age_s[row] <= self.age_max_s)
