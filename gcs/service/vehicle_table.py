"""Per-vehicle state of one snapshot, as columns."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.lifecycle import Phase
from gcs.model.state import Array, Counts, Landed, Mask, Mode, VehicleId, counts_of, freeze

VECTORS: Final = ("position_m", "velocity_m_s", "setpoint_m_s")
VALUES: Final = (
    *("yaw_rad", "latitude_deg", "longitude_deg", "altitude_amsl_m", "battery_remaining", "position_age_s"),
    *("uncertainty_m", "heartbeat_age_s", "link_quality", "fix_type"),
)


@dataclass(frozen=True, slots=True, eq=False)
class VehicleTable:
    """Estimated and reported state of all vehicles; n rows, show frame. NaN (or inf): not known.

    A thousand vehicles as columns cost what ten cost as objects. Raises: ShapeError.
    """

    ids: Sequence[VehicleId]
    system_ids: Sequence[int]
    links: Sequence[str]
    autopilots: Sequence[str]  # names, as configured
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
    stations: Sequence[str] = ()  # which station flies each; empty: one station flies all

    def __post_init__(self) -> None:
        n = len(self.ids)
        for name in VECTORS:
            freeze(getattr(self, name), (n, 3), name)
        for name in VALUES:
            freeze(getattr(self, name), (n,), name)

    def __reduce__(self) -> tuple[Any, ...]:
        """Homes as one array: a thousand small ones would take as long as all other columns."""
        columns = {field.name: getattr(self, field.name) for field in fields(self)}
        homes_m = columns.pop("homes_m")
        known = [home_m is not None for home_m in homes_m]
        return _restored, (columns, known, np.array([home_m for home_m in homes_m if home_m is not None]))

    def of(self, rows: NDArray[np.intp]) -> "VehicleTable":
        """These rows, in this order."""
        chosen = rows.tolist()
        columns: dict[str, Any] = {}
        for field in fields(self):
            column = getattr(self, field.name)
            if len(column):
                arrays = isinstance(column, np.ndarray)
                columns[field.name] = column[rows] if arrays else [column[row] for row in chosen]
        return VehicleTable(**columns)

    def counts(self) -> Counts:
        return counts_of(self.phases, self.landed, self.armed, self.heartbeat_age_s.tolist())

    def lights(self) -> list[str | None]:
        """Colour that the show sets for each vehicle, #rrggbb; None: it sets none."""
        colours = zip(self.colour.tolist(), self.lit, strict=True)
        return ["#{:02x}{:02x}{:02x}".format(*colour) if lit else None for colour, lit in colours]


def _restored(columns: dict[str, Any], known: list[bool], homes_m: Array) -> VehicleTable:
    homes = iter(homes_m)
    return VehicleTable(**columns, homes_m=[next(homes) if is_known else None for is_known in known])
