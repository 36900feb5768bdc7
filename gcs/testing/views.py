"""The vehicles of a snapshot one by one, for assertions about single ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from gcs.model.lifecycle import Phase
from gcs.model.state import Landed, Mode, VehicleId
from gcs.service import FleetView


@dataclass(frozen=True, slots=True)
class VehicleView:
    """One row of `gcs.service.vehicle_table.VehicleTable`. None: not known."""

    id: VehicleId
    phase: Phase
    reason: str
    mode: Mode
    armed: bool
    landed: Landed
    ready: bool
    position_m: tuple[float, float, float] | None  # show frame
    velocity_m_s: tuple[float, float, float] | None
    setpoint_m_s: tuple[float, float, float] | None
    battery_remaining: float | None
    position_age_s: float | None
    heartbeat_age_s: float | None
    position_uncertainty_m: float
    limited_by: str
    colour: str | None


def vehicles_of(view: FleetView) -> tuple[VehicleView, ...]:
    rows = view.rows
    vectors = (rows.position_m, rows.velocity_m_s, rows.setpoint_m_s)
    values = (rows.battery_remaining, rows.position_age_s, rows.heartbeat_age_s)
    columns = (
        *(rows.ids, rows.phases, rows.reasons, rows.modes),
        *(map(bool, rows.armed), rows.landed, map(bool, rows.ready)),
        *(map(_triple, column.tolist()) for column in vectors),
        *(map(_known, column.tolist()) for column in values),
        *(rows.uncertainty_m.tolist(), rows.limited_by, rows.colours()),
    )
    return tuple(VehicleView(*row) for row in zip(*columns, strict=True))


def _triple(row: Sequence[float]) -> tuple[float, float, float] | None:
    x, y, z = row
    return (x, y, z) if isfinite(x) and isfinite(y) and isfinite(z) else None


def _known(value: float) -> float | None:
    return value if isfinite(value) else None
