"""Per-vehicle state of one snapshot, as columns; the numbers among them are `gcs.model.vehicle_columns`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.lifecycle import Phase
from gcs.model.state import Array, Counts, Landed, Mask, Mode, VehicleId, counts_of, freeze
from gcs.model.vehicle_columns import COLUMNS, VehicleNumbers, unknown

VECTORS: Final = ("position_m", "velocity_m_s", "setpoint_m_s")

_NUMBERS: Final = attrgetter(*COLUMNS)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VehicleTable(VehicleNumbers):
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
    limited_by: Sequence[str]
    colour: NDArray[np.uint8]  # (n, 3) red, green, blue that the show sets now
    lit: Mask  # (n,) whether it sets one
    homes_m: Sequence[Array | None]  # (3,) each, where they took off
    stations: Sequence[str] = ()  # which station flies each; empty: one station flies all

    def __post_init__(self) -> None:
        n = len(self.ids)
        for name in VECTORS:
            freeze(getattr(self, name), (n, 3), name)
        for name, column in zip(COLUMNS, _NUMBERS(self), strict=True):
            freeze(column, (n,), name)

    def __reduce__(self) -> tuple[Any, ...]:
        """Homes as one array: a thousand small ones would take as long as all other columns."""
        columns = {field.name: getattr(self, field.name) for field in fields(self)}
        homes_m = columns.pop("homes_m")
        has_home = [home_m is not None for home_m in homes_m]
        return _restored, (columns, has_home, np.array([home_m for home_m in homes_m if home_m is not None]))

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

    def followed_by(self, columns: Mapping[str, Sequence[Any] | NDArray[Any]]) -> "VehicleTable":
        """These rows, then others with these columns, in which numbers may be missing: they are not known."""
        columns = {**unknown(len(columns["ids"])), **columns}
        joined: dict[str, Any] = {}
        for field in fields(self):
            first, then = getattr(self, field.name), columns[field.name]
            joined[field.name] = (
                np.concatenate([first, then]) if isinstance(first, np.ndarray) else [*first, *then]
            )
        return VehicleTable(**joined)

    def counts(self) -> Counts:
        return counts_of(self.phases, self.landed, self.armed, self.heartbeat_age_s.tolist())

    def colours(self) -> list[str | None]:
        """Colour that the show sets for each vehicle, #rrggbb; None: it sets none."""
        colours = zip(self.colour.tolist(), self.lit, strict=True)
        return ["#{:02x}{:02x}{:02x}".format(*colour) if lit else None for colour, lit in colours]


def _restored(columns: dict[str, Any], has_home: list[bool], homes_m: Array) -> VehicleTable:
    homes = iter(homes_m)
    return VehicleTable(**columns, homes_m=[next(homes) if is_known else None for is_known in has_home])
