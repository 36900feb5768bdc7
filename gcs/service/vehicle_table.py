"""Per-vehicle state of one snapshot, as columns or as `VehicleView` objects."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from gcs.model.lifecycle import Phase
from gcs.model.state import Array, Counts, Landed, Mask, Mode, VehicleId, counts_of, freeze


@dataclass(frozen=True, slots=True)
class VehicleView:
    """Estimated and reported state of one vehicle. None: not known."""

    id: VehicleId
    system_id: int
    link: str
    phase: Phase
    reason: str  # why it is in that phase, in words
    mode: Mode
    armed: bool
    landed: Landed
    ready: bool
    position_m: tuple[float, float, float] | None  # show frame
    velocity_m_s: tuple[float, float, float] | None
    yaw_rad: float | None
    latitude_deg: float | None
    longitude_deg: float | None
    altitude_amsl_m: float | None
    battery_remaining: float | None  # 0 to 1
    position_age_s: float | None
    position_uncertainty_m: float  # margin for its reported accuracy, or a jump; sideways
    heartbeat_age_s: float | None
    setpoint_m_s: tuple[float, float, float] | None  # sent in the last tick; None: not commanded
    link_quality: float | None  # share of the requested position messages that arrive, 0 to 1
    limited_by: str  # why the safety filter limited it, "" if it did not
    light: str | None = None  # colour that the show sets now, #rrggbb; None: it has no part in one


@dataclass(frozen=True, slots=True, eq=False)
class VehicleTable:
    """Estimated and reported state of all vehicles; n rows, show frame. NaN (or inf): not known.

    A thousand vehicles as columns cost what ten cost as objects. Raises: ShapeError.
    """

    ids: Sequence[VehicleId]
    system_ids: Sequence[int]
    links: Sequence[str]
    phases: Sequence[Phase]
    reasons: Sequence[str]
    modes: Sequence[Mode]
    armed: Sequence[bool]
    landed: Sequence[Landed]
    ready: Sequence[bool]
    position_m: Array  # (n, 3)
    velocity_m_s: Array  # (n, 3)
    setpoint_m_s: Array  # (n, 3) sent in the last tick; NaN: not commanded
    yaw_rad: Array  # (n,)
    latitude_deg: Array  # (n,)
    longitude_deg: Array  # (n,)
    altitude_amsl_m: Array  # (n,)
    battery_remaining: Array  # (n,)
    position_age_s: Array  # (n,)
    uncertainty_m: Array  # (n,)
    heartbeat_age_s: Array  # (n,)
    link_quality: Array  # (n,)
    fix_type: Array  # (n,) GPS_FIX_TYPE
    limited_by: Sequence[str]
    colour: NDArray[np.uint8]  # (n, 3) red, green, blue that the show sets now
    lit: Mask  # (n,) whether it sets one
    homes_m: Sequence[Array | None]  # (3,) each, where they took off

    def __post_init__(self) -> None:
        n = len(self.ids)
        for name in ("position_m", "velocity_m_s", "setpoint_m_s"):
            freeze(getattr(self, name), (n, 3), name)
        for name in (
            "yaw_rad",
            "latitude_deg",
            "longitude_deg",
            "altitude_amsl_m",
            "battery_remaining",
            "position_age_s",
            "uncertainty_m",
            "heartbeat_age_s",
            "link_quality",
            "fix_type",
        ):
            freeze(getattr(self, name), (n,), name)

    def counts(self) -> Counts:
        return counts_of(self.phases, self.landed, self.armed, self.heartbeat_age_s.tolist())

    def one_by_one(self) -> tuple[VehicleView, ...]:
        position_m, velocity_m_s, setpoint_m_s = (
            [_triple(row) for row in rows.tolist()]
            for rows in (self.position_m, self.velocity_m_s, self.setpoint_m_s)
        )
        yaw_rad, latitude_deg, longitude_deg, altitude_m, battery, age_s, beat_age_s, quality = (
            [_known(value) for value in column.tolist()]
            for column in (
                self.yaw_rad,
                self.latitude_deg,
                self.longitude_deg,
                self.altitude_amsl_m,
                self.battery_remaining,
                self.position_age_s,
                self.heartbeat_age_s,
                self.link_quality,
            )
        )
        uncertainty_m, colours = self.uncertainty_m.tolist(), self.colour.tolist()
        return tuple(
            VehicleView(
                id=name,
                system_id=self.system_ids[row],
                link=self.links[row],
                phase=self.phases[row],
                reason=self.reasons[row],
                mode=self.modes[row],
                armed=bool(self.armed[row]),
                landed=self.landed[row],
                ready=bool(self.ready[row]),
                position_m=position_m[row],
                velocity_m_s=velocity_m_s[row],
                yaw_rad=yaw_rad[row],
                latitude_deg=latitude_deg[row],
                longitude_deg=longitude_deg[row],
                altitude_amsl_m=altitude_m[row],
                battery_remaining=battery[row],
                position_age_s=age_s[row],
                position_uncertainty_m=uncertainty_m[row],
                heartbeat_age_s=beat_age_s[row],
                setpoint_m_s=setpoint_m_s[row],
                link_quality=quality[row],
                limited_by=self.limited_by[row],
                light="#{:02x}{:02x}{:02x}".format(*colours[row]) if self.lit[row] else None,
            )
            for row, name in enumerate(self.ids)
        )


def _triple(row: Sequence[float]) -> tuple[float, float, float] | None:
    x, y, z = row
    return (x, y, z) if isfinite(x) and isfinite(y) and isfinite(z) else None


def _known(value: float) -> float | None:
    return value if isfinite(value) else None
