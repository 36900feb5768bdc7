"""Telemetry in, FleetState out: the one place where the fleet's state is made."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.frames import ShowFrame, wrap_rad
from gcs.state import Array, FleetState, Mask, Telemetry, VehicleId

FORWARD_MAX_S = 0.5
"""Positions are brought forward by no more than this; what is older is refused by its age anyway."""


SPEED_PLAUSIBLE_M_S, JUMP_PLAUSIBLE_M = 25.0, 10.0
"""A position farther from the last believed one than this speed and this jump explain is not believed."""

UNEXPLAINED_M, UNEXPLAINED_M_S = 1.5, 2.0
"""A believed position that is off by more than this and this speed from where the velocity led is a reset: of
the estimator, or of its receiver. Noise comes in centimetres a step.
"""

FAR_M = 10_000.0
"""Nor is one farther than this from the show's origin, or at latitude and longitude 0."""

CONSISTENT_S = 2.0
"""How long a vehicle must have been told at a new place, without a jump, before the new place is believed."""


class Table:
    """Joins the telemetry of all links into one state, rows in the fleet's own order.

    It remembers the last position of each vehicle that was believed, for positions are not believed
    blindly (a receiver that glitches, an estimator that resets, another vehicle's messages). While a vehicle
    tells an implausible one, its row keeps the last believed position, and the age inf: nobody commands it.
    It is believed again at once where it comes back to where it can be, and otherwise after CONSISTENT_S at
    the new place: in the air only if it can have flown there, on the ground (not armed) wherever that is.

    Attributes:
        reset_time_s: (n,) when the position last jumped, as the velocity does not explain or as the estimator
            said itself; -inf where it never did. Only of the armed: an estimator that starts up jumps, too.
    """

    def __init__(self, ids: Sequence[VehicleId], frame: ShowFrame) -> None:
        self.ids = tuple(ids)
        self._row = {vehicle_id: row for row, vehicle_id in enumerate(self.ids)}
        self._rows: dict[tuple[VehicleId, ...], NDArray[np.intp]] = {}  # of each link's vehicles
        self._frame = frame
        self._believed = _Track.unknown(len(self.ids))  # the newest that was believed
        self._told = _Track.unknown(len(self.ids))  # the newest, believed or not
        self._velocity_m_s = np.full((len(self.ids), 3), np.nan)  # with the believed position
        self._trusted = np.ones(len(self.ids), dtype=bool)
        self._told_since_s = np.full(len(self.ids), np.inf)  # without a jump, of those not trusted
        self._resets = np.full(len(self.ids), -1)  # as the estimators count them
        self.reset_time_s = np.full(len(self.ids), -np.inf)

    def state(self, telemetry: Sequence[Telemetry], now_s: float) -> FleetState:
        """Where everybody is at `now_s`: newest believed positions, brought forward with their velocities.

        Called once a tick; called again with the same telemetry it says the same.
        """
        n = len(self.ids)
        told = _Track.unknown(n)
        velocity_m_s, yaw_rad = np.full((n, 3), np.nan), np.full(n, np.nan)
        exists, armed = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        resets = self._resets.copy()
        for part in telemetry:
            rows = self._rows_of(part.ids)
            told.position_m[rows] = self._frame.position_m(
                part.latitude_deg, part.longitude_deg, part.altitude_amsl_m
            )
            told.time_s[rows] = part.position_time_s
            velocity_m_s[rows] = self._frame.from_ned(part.velocity_ned_m_s)
            yaw_rad[rows] = wrap_rad(np.radians(part.yaw_deg - self._frame.heading_deg))
            exists[rows] = (part.latitude_deg != 0.0) | (part.longitude_deg != 0.0)
            armed[rows] = part.armed
            resets[rows] = part.position_resets
        exists &= np.linalg.norm(told.position_m, axis=1) <= FAR_M  # False for NaN
        before, before_m_s = self._believed, self._velocity_m_s
        self._judge(told, exists, armed)
        counted = (resets != self._resets) & (self._resets >= 0)
        self._resets = resets
        self.reset_time_s = np.where(
            armed & (counted | self._jumped(before, before_m_s, velocity_m_s)), now_s, self.reset_time_s
        )
        self._velocity_m_s = np.where(
            (self._believed.time_s == told.time_s)[:, None], velocity_m_s, self._velocity_m_s
        )
        age_s = np.maximum(now_s - self._believed.time_s, 0.0)
        forward_m = self._velocity_m_s * np.minimum(age_s, FORWARD_MAX_S)[:, None]
        return FleetState(
            now_s,
            self.ids,
            self._believed.position_m + forward_m,
            self._velocity_m_s.copy(),
            yaw_rad,
            np.where(self._trusted, age_s, np.inf),
        )

    def _jumped(self, before: "_Track", before_m_s: Array, velocity_m_s: Array) -> Mask:
        """(n,) whose newest believed position the velocities before it and with it do not explain."""
        now = self._believed
        new = (now.time_s > before.time_s) & np.isfinite(before.time_s)
        elapsed_s = np.where(new, now.time_s - np.where(new, before.time_s, 0.0), 0.0)
        flown_m = (before_m_s + velocity_m_s) / 2.0 * elapsed_s[:, None]
        off_m = np.linalg.norm(now.position_m - before.position_m - flown_m, axis=1)
        jumped: Mask = new & (off_m > UNEXPLAINED_M + UNEXPLAINED_M_S * elapsed_s)  # False for NaN
        return jumped

    def _rows_of(self, ids: tuple[VehicleId, ...]) -> NDArray[np.intp]:
        rows = self._rows.get(ids)
        if rows is None:
            rows = self._rows[ids] = np.array([self._row[vehicle_id] for vehicle_id in ids], dtype=np.intp)
        return rows

    def _judge(self, told: "_Track", exists: Mask, armed: Mask) -> None:
        """Believe what is new in `told`, or do not; `exists` says where it can be a place at all."""
        new = told.time_s > self._told.time_s
        at_s = np.where(new, told.time_s, 0.0)
        off_m, before_m = self._believed.off_m(told), self._told.off_m(told)
        first = ~np.isfinite(self._believed.time_s)
        can_be = first | (off_m <= self._believed.plausible_m(told))
        went_on = before_m <= self._told.plausible_m(told)  # from the last one told, believed or not
        since_s = np.where(~self._trusted & went_on, self._told_since_s, at_s)
        settled = went_on & (at_s - since_s >= CONSISTENT_S)
        came_back = off_m <= before_m
        believe = exists & np.where(
            self._trusted | first, can_be, (can_be & came_back) | (settled & (can_be | ~armed))
        )
        self._trusted = np.where(new, believe, self._trusted)
        self._told_since_s = np.where(new, since_s, self._told_since_s)
        self._told = self._told.replaced(told, new, exists)
        self._believed = self._believed.replaced(told, new & believe, exists)


@dataclass(frozen=True, slots=True, eq=False)
class _Track:
    """The end of each vehicle's track. Owns its arrays."""

    position_m: Array  # (n, 3) show frame
    time_s: Array  # (n,) of arrival, -inf where unknown

    @staticmethod
    def unknown(count: int) -> "_Track":
        return _Track(np.full((count, 3), np.nan), np.full(count, -np.inf))

    def off_m(self, told: "_Track") -> Array:
        """(n,) how far away `told` is; inf where either is no place."""
        off_m = np.linalg.norm(told.position_m - self.position_m, axis=1)
        return np.where(np.isfinite(off_m), off_m, np.inf)

    def plausible_m(self, told: "_Track") -> Array:
        """(n,) how far away `told` may be; nothing where this is unknown."""
        since_s = np.where(np.isfinite(self.time_s), self.time_s, told.time_s)
        elapsed_s = np.maximum(told.time_s, since_s) - np.where(np.isfinite(since_s), since_s, 0.0)
        plausible_m: Array = JUMP_PLAUSIBLE_M + SPEED_PLAUSIBLE_M_S * np.maximum(elapsed_s, 0.0)
        return plausible_m

    def replaced(self, told: "_Track", rows: Mask, exists: Mask) -> "_Track":
        """With those of `rows` as told; their place unknown where it is none."""
        place_m = np.where(exists[:, None], told.position_m, np.nan)
        return _Track(
            np.where(rows[:, None], place_m, self.position_m), np.where(rows, told.time_s, self.time_s)
        )


def tuple3(row: Array) -> tuple[float, float, float] | None:
    """A finite (3,) row as plain numbers, else None."""
    if not np.isfinite(row).all():
        return None
    return float(row[0]), float(row[1]), float(row[2])
