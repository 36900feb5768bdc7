"""Telemetry in, FleetState out: the one place where the fleet's state is made."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs.frames import ShowFrame
from gcs.state import Array, FleetState, Telemetry, VehicleId
from gcs.table_kernels import brought_forward, into_frame, judge


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
        self._origin = (frame.latitude_deg, frame.longitude_deg, frame.altitude_amsl_m, frame.heading_deg)
        n = len(self.ids)
        self._believed_m, self._believed_s = np.full((n, 3), np.nan), np.full(n, -np.inf)
        self._believed_m_s = np.full((n, 3), np.nan)  # with the believed position
        self._told_m, self._told_s = np.full((n, 3), np.nan), np.full(n, -np.inf)  # believed or not
        self._told_since_s = np.full(n, np.inf)  # without a jump, of those not trusted
        self._trusted = np.ones(n, dtype=np.bool_)
        self._resets = np.full(n, -1)  # as the estimators count them
        self.reset_time_s = np.full(n, -np.inf)

    def state(self, telemetry: Sequence[Telemetry], now_s: float) -> FleetState:
        """Where everybody is at `now_s`: newest believed positions, brought forward with their velocities.

        Called once a tick; called again with the same telemetry it says the same.
        """
        n = len(self.ids)
        position_m, velocity_m_s, yaw_rad = (
            np.full((n, 3), np.nan),
            np.full((n, 3), np.nan),
            np.full(n, np.nan),
        )
        time_s, exists, armed = np.full(n, -np.inf), np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        resets = self._resets.copy()
        for part in telemetry:
            rows = self._rows_of(part.ids)
            into_frame(
                rows,
                part.latitude_deg,
                part.longitude_deg,
                part.altitude_amsl_m,
                part.velocity_ned_m_s,
                part.yaw_deg,
                self._origin,
                position_m,
                velocity_m_s,
                yaw_rad,
                exists,
            )
            time_s[rows] = part.position_time_s
            armed[rows] = part.armed
            resets[rows] = part.position_resets
        self.reset_time_s = self.reset_time_s.copy()  # whoever has the old one keeps it
        judge(
            now_s,
            position_m,
            time_s,
            velocity_m_s,
            exists,
            armed,
            resets,
            self._told_m,
            self._told_s,
            self._told_since_s,
            self._believed_m,
            self._believed_s,
            self._believed_m_s,
            self._trusted,
            self._resets,
            self.reset_time_s,
        )
        here_m, age_s = brought_forward(
            now_s, self._believed_m, self._believed_s, self._believed_m_s, self._trusted
        )
        return FleetState(now_s, self.ids, here_m, self._believed_m_s.copy(), yaw_rad, age_s)

    def _rows_of(self, ids: tuple[VehicleId, ...]) -> NDArray[np.intp]:
        rows = self._rows.get(ids)
        if rows is None:
            rows = self._rows[ids] = np.array([self._row[vehicle_id] for vehicle_id in ids], dtype=np.intp)
        return rows


def tuple3(row: Array) -> tuple[float, float, float] | None:
    """A finite (3,) row as plain numbers, else None."""
    if not np.isfinite(row).all():
        return None
    return float(row[0]), float(row[1]), float(row[2])
