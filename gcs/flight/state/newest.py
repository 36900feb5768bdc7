"""What a flight knows and follows now: replaced with every tick, or by a command."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from gcs.control import ControlSettings, Memory
from gcs.flight.state.vehicle import Vehicle
from gcs.model.plan import Plan, Target
from gcs.model.state import (
    Array,
    FleetState,
    Mask,
    Mode,
    Telemetry,
    Traits,
    VehicleId,
    Whereabouts,
    whereabouts,
)
from gcs.safety.near_traffic import NearTraffic


class Newest:
    """What is known as of the newest tick. Its holders read it anew with every tick."""

    state: FleetState
    telemetry: Telemetry
    traits: Traits
    memory: Memory
    # as judged by `telemetry_monitor` at the beginning of the tick, rows as in FleetState:
    silent: Mask  # see `gcs.estimation.link_health`
    has_heartbeat: Mask  # within `operation.silence_s`
    without_heartbeat: dict[VehicleId, str]  # airborne, sends positions: since when, in words

    near_traffic: NearTraffic | None = None  # traffic that vehicles keep clear of in the next tick
    kept_clear: Mapping[str, Target] = MappingProxyType({})  # targets with a clearance, followed or not
    wind_m_s: float = 0.0  # greatest that was measured since the take-off, with gusts; 0: none
    manned: str = ""  # a manned aircraft that is too near, in words; empty: there is none

    def position_m(self, vehicle: Vehicle) -> Array:
        """(3,) Newest position, show frame."""
        return np.asarray(self.state.position_m[vehicle.row])

    def mode(self, vehicle: Vehicle) -> Mode:
        return self.telemetry.mode[vehicle.row]

    def uncertainty_m(self, vehicles: Sequence[Vehicle]) -> Array:
        """(k,) standard deviations of these vehicles' positions, sideways."""
        return self.traits.uncertainty_m[[vehicle.row for vehicle in vehicles]]

    def whereabouts(self, vehicle: Vehicle) -> Whereabouts:
        """Whether it is airborne and under control, on the ground, or unknown; see `fleet_counts`."""
        telemetry, at = self.telemetry, vehicle.row
        age_s = self.state.time_s - float(telemetry.heartbeat_time_s[at])
        landed, armed = telemetry.landed[at], telemetry.armed[at]
        return whereabouts(vehicle.phase, landed, armed=armed, heartbeat_age_s=age_s)


@dataclass
class InForce:
    """What the operator has set."""

    plan: Plan
    control: ControlSettings  # narrower while a show is selected
