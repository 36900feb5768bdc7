"""Per-vehicle state of one snapshot, as columns or as `VehicleView` objects."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final

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
    position_uncertainty_m: float  # standard deviation, sideways
    heartbeat_age_s: float | None
    setpoint_m_s: tuple[float, float, float] | None  # sent in the last tick; None: not commanded
    link_quality: float | None  # share of the requested position messages that arrive, 0 to 1
    limited_by: str  # why the safety filter limited it, "" if it did not
    light: str | None = None  # colour that the show sets now, #rrggbb; None: it has no part in one


VECTORS: Final = ("position_m", "velocity_m_s", "setpoint_m_s")
KNOWN_OR_NONE: Final = (
    *("yaw_rad", "latitude_deg", "longitude_deg", "altitude_amsl_m"),
    *("battery_remaining", "position_age_s", "heartbeat_age_s", "link_quality"),
)
"""Columns of one value each that `VehicleView` has under the same name."""


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
        for name in VECTORS:
            freeze(getattr(self, name), (n, 3), name)
        for name in (*KNOWN_OR_NONE, "uncertainty_m", "fix_type"):
            freeze(getattr(self, name), (n,), name)

    def counts(self) -> Counts:
        return counts_of(self.phases, self.landed, self.armed, self.heartbeat_age_s.tolist())

    def lights(self) -> list[str | None]:
        """Colour that the show sets for each vehicle, #rrggbb; None: it sets none."""
        colours = zip(self.colour.tolist(), self.lit, strict=True)
        return ["#{:02x}{:02x}{:02x}".format(*colour) if lit else None for colour, lit in colours]

    def one_by_one(self) -> tuple[VehicleView, ...]:
        columns: dict[str, Iterable[Any]] = {
            "id": self.ids,
            "system_id": self.system_ids,
            "link": self.links,
            "phase": self.phases,
            "reason": self.reasons,
            "mode": self.modes,
            "armed": map(bool, self.armed),
            "landed": self.landed,
            "ready": map(bool, self.ready),
            "position_uncertainty_m": self.uncertainty_m.tolist(),
            "limited_by": self.limited_by,
            "light": self.lights(),
            **{name: map(_triple, getattr(self, name).tolist()) for name in VECTORS},
            **{name: map(_known, getattr(self, name).tolist()) for name in KNOWN_OR_NONE},
        }
        rows = zip(*columns.values(), strict=True)
        return tuple(VehicleView(**dict(zip(columns, row, strict=True))) for row in rows)


def _triple(row: Sequence[float]) -> tuple[float, float, float] | None:
    x, y, z = row
    return (x, y, z) if isfinite(x) and isfinite(y) and isfinite(z) else None


def _known(value: float) -> float | None:
    return value if isfinite(value) else None
