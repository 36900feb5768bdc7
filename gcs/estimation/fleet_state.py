"""The fleet's state from the telemetry of all links."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.estimation.kernels import brought_forward, into_frame, judge
from gcs.model.frames import ShowFrame
from gcs.model.state import Array, FleetState, Telemetry, VehicleId

FLIES_ON_S: Final = 2.0
"""Age of telemetry up to which a vehicle may fly on unchanged, with PX4's and the service's defaults: 0.5 s
for which positions are brought forward, the watchdog's 0.2 s and COM_OF_LOSS_T of 1 s; or the 2 s after which
it counts as lost, whichever is longer.
"""

BRAKES_S: Final = 2.0
"""Even braking over this time covers the distance of 1 s of unchanged flight (`STOP_S`)."""


class Table:
    """Joins the telemetry of all links into one state, rows in the fleet's own order.

    It keeps the last accepted position of each vehicle, since a reported position may be wrong (a receiver
    that glitches, an estimator that resets, another vehicle's messages). While a vehicle reports implausible
    positions, its row keeps the last accepted one, and the age inf: it is not commanded. Its positions are
    accepted again at once where they return to a reachable place, and otherwise after CONSISTENT_S at the new
    place: in the air only if it can have flown there, on the ground (not armed) anywhere.

    The velocity of a vehicle without new telemetry ends. For `flies_on_s` it is the last reported one: the
    vehicle may fly on until its autopilot notices the loss, and other vehicles must keep clear of it by
    this estimate alone until it counts as lost. Within `brakes_s` it then fades to rest, as of a vehicle
    that brakes; a falling vehicle does not move sideways for long either. The growing uncertainty is not in
    the velocity: from the loss on, the swept space (`gcs.planning.landing_sites.swept_segments_m`) covers
    every place that the vehicle can have reached with the whole of `last_velocity_m_s`, however long ago that
    was.

    Attributes:
        reset_time_s: (n,) when the position last jumped, beyond what the velocity explains or by the
            estimator's own report; -inf where it never did. Only of armed vehicles: an estimator that starts
            up also jumps.
    """

    def __init__(
        self,
        ids: Sequence[VehicleId],
        frame: ShowFrame,
        *,
        flies_on_s: float = FLIES_ON_S,
        brakes_s: float = BRAKES_S,
    ) -> None:
        self._flies_on_s, self._brakes_s = flies_on_s, brakes_s
        self.ids = tuple(ids)
        self._row = {vehicle_id: row for row, vehicle_id in enumerate(self.ids)}
        self._rows: dict[tuple[VehicleId, ...], NDArray[np.intp]] = {}  # of each link's vehicles
        self._origin = (frame.latitude_deg, frame.longitude_deg, frame.altitude_amsl_m, frame.heading_deg)
        n = len(self.ids)
        self._believed_m, self._believed_s = np.full((n, 3), np.nan), np.full(n, -np.inf)
        self._believed_m_s = np.full((n, 3), np.nan)  # with the accepted position
        self._reported_m, self._reported_s = np.full((n, 3), np.nan), np.full(n, -np.inf)  # accepted or not
        self._reported_since_s = np.full(n, np.inf)  # without a jump, of vehicles not trusted
        self._trusted = np.ones(n, dtype=np.bool_)
        self._resets = np.full(n, -1)  # reset counters of the estimators
        self.reset_time_s = np.full(n, -np.inf)

    def state(self, telemetry: Sequence[Telemetry], now_s: float) -> FleetState:
        """The fleet at `now_s`: newest accepted positions, brought forward with their velocities.

        Called once a tick; a second call with the same telemetry has the same result.
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
        self.reset_time_s = self.reset_time_s.copy()  # holders of the old array keep it unchanged
        judge(
            now_s,
            position_m,
            time_s,
            velocity_m_s,
            exists,
            armed,
            resets,
            self._reported_m,
            self._reported_s,
            self._reported_since_s,
            self._believed_m,
            self._believed_s,
            self._believed_m_s,
            self._trusted,
            self._resets,
            self.reset_time_s,
        )
        here_m, moves_m_s, age_s = brought_forward(
            now_s,
            self._believed_m,
            self._believed_s,
            self._believed_m_s,
            self._trusted,
            self._flies_on_s,
            self._brakes_s,
        )
        return FleetState(now_s, self.ids, here_m, moves_m_s, yaw_rad, age_s)

    @property
    def last_velocity_m_s(self) -> Array:
        """(n, 3) the whole velocity that came with each vehicle's last accepted position."""
        return self._believed_m_s.copy()

    def _rows_of(self, ids: tuple[VehicleId, ...]) -> NDArray[np.intp]:
        rows = self._rows.get(ids)
        if rows is None:
            rows = self._rows[ids] = np.array([self._row[vehicle_id] for vehicle_id in ids], dtype=np.intp)
        return rows


def tuple3(row: Array) -> tuple[float, float, float] | None:
    """A finite (3,) row as floats, else None."""
    if not np.isfinite(row).all():
        return None
    return float(row[0]), float(row[1]), float(row[2])
