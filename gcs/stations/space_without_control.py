"""The space closed to others by vehicles of other stations that no station commands."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.setpoint_loss import FleetWithoutSetpoints, WithoutSetpoints
from gcs.model.state import Array, Mask, VehicleId
from gcs.planning.lost_space import KeptSetpoints, expected_drift, swept_segments_m
from gcs.planning.silent_space import silent_segments_m
from gcs.stations.reported_vehicles import HAS_NO_LINK, KILLED, WITHOUT_LINK, ReportedVehicles, Rows

RETURN_HEIGHT_M: Final = 30.0


@dataclass(frozen=True, slots=True)
class WithoutControl:
    """What vehicles do that no station commands; as configured for the whole site."""

    action: str = "return"  # see `swept_segments_m`; of vehicles that are not in `vehicles`
    return_heights_m: Mapping[VehicleId, float] = field(default_factory=dict)  # RTL_RETURN_ALT, if not 30 m
    takeoff_height_m: float = 10.0
    vehicles: Mapping[VehicleId, WithoutSetpoints] = field(default_factory=dict)
    silence_s: float = 2.0  # a vehicle is lost after it
    watchdog_s: float = 0.2  # how long setpoints outlive their tick
    telemetry_age_max_s: float = 0.5  # a vehicle with an older position is not commanded

    def of(self, ids: Sequence[VehicleId]) -> FleetWithoutSetpoints:
        others = WithoutSetpoints(action=self.action)
        return FleetWithoutSetpoints([self.vehicles.get(name, others) for name in ids])


class SpaceWithoutControl:
    """Paths that the k vehicles of other stations may take without control, from where each was seen last."""

    def __init__(
        self, ids: tuple[VehicleId, ...], reported: ReportedVehicles, home_m: Array, settings: WithoutControl
    ) -> None:
        """Nothing is known of any vehicle at first.

        Args:
            ids: (k,) vehicles.
            reported: what is reported of them, changed by others.
            home_m: (k, 3) where they took off, show frame, changed by others; NaN: not known.
            settings: what they do.
        """
        self._ids, self._known, self._home_m, self._settings = ids, reported, home_m, settings
        self._alone = settings.of(ids)
        self._kept = KeptSetpoints(len(ids))
        self._swept: dict[int, Array] = {}  # by row, of paths that do not change any more

    def note(self, age_s: Array, now_s: float, ended: Mask) -> None:
        """Begin a tick; arguments as of `KeptSetpoints.note`."""
        self._kept.note(self._known.desired_m_s, self._known.setpoint_m_s, age_s, now_s, ended)

    def forget_seen(self, now_s: float) -> None:
        """Forget the paths of vehicles that are commanded again."""
        reported = self._known
        for row in [row for row in self._swept if reported.phases[row] not in WITHOUT_LINK]:
            if now_s - reported.measured_s[row] <= self._settings.telemetry_age_max_s:
                del self._swept[row]

    def closed(self, rows: Rows) -> tuple[Array, Rows]:
        """(m, 2, 3) all paths that lost vehicles may take until they are seen again, and (m,) their rows."""
        swept = [(row, self._swept_of(row)) for row in rows.tolist()]
        of = [row for row, own_m in swept for _ in own_m]
        return np.concatenate([np.zeros((0, 2, 3)), *(own_m for _, own_m in swept)]), np.array(of, np.intp)

    def paths(
        self, rows: NDArray[np.intp], age_s: Array
    ) -> tuple[Array, NDArray[np.intp], tuple[Array, Array] | None]:
        """(m, 2, 3) paths of vehicles without control, (m,) their rows, and where they drift now."""
        if len(rows) == 0:
            return np.zeros((0, 2, 3)), np.zeros(0, np.intp), None
        near = np.array([row not in self._swept for row in rows.tolist()])
        near &= (age_s[rows] < self._settings.silence_s) & ~HAS_NO_LINK[self._known.phases[rows]]
        silent_m, silent_of = self._near(rows[near], age_s)
        swept = {row: self._swept_m(row) for row in rows[~near].tolist()}
        segments_m = np.concatenate([*swept.values(), silent_m])
        owners = np.repeat(np.array([*swept], np.intp), [len(each_m) for each_m in swept.values()])
        owners = np.concatenate([owners, silent_of])
        by_row = np.argsort(owners, kind="stable")
        drifts = np.zeros(len(self._ids), np.bool_)
        drifts[rows] = self._known.phases[rows] != KILLED
        expected_m_s = self._kept.expected_m_s(self._known.velocity_m_s)
        stop_s = self._alone.stop_s(np.arange(len(self._ids)), expected_m_s)
        noticed_s = self._alone.flies_on_s
        drift = expected_drift(
            self._known.position_m, expected_m_s, age_s, drifts, noticed_s=noticed_s, stop_s=stop_s
        )
        return segments_m[by_row], owners[by_row], drift

    def _near(self, rows: NDArray[np.intp], age_s: Array) -> tuple[Array, NDArray[np.intp]]:
        """(m, 2, 3) paths that silent vehicles may take soon, and (m,) their rows."""
        alone = self._settings
        of, keeps_m_s = self._kept.possible_m_s(rows, self._known.velocity_m_s)
        segments_m, segment_of = silent_segments_m(
            self._known.position_m[of],
            keeps_m_s,
            self._home_m[of],
            np.array([alone.return_heights_m.get(self._ids[row], RETURN_HEIGHT_M) for row in of.tolist()]),
            age_s[of],
            action=self._alone.action[of],
            noticed_s=self._alone.flies_on_s[of],
            drift_s=self._drift_s(of, keeps_m_s),
        )
        return segments_m, of[segment_of]

    def _swept_m(self, row: int) -> Array:
        """(m, 2, 3) paths that a lost vehicle may take; they stay as they are."""
        if row not in self._swept:
            self._swept[row] = self._swept_of(row)
        return self._swept[row]

    def _swept_of(self, row: int) -> Array:
        """(m, 2, 3) all paths that one vehicle may take by itself."""
        if row in self._swept:
            return self._swept[row]
        alone, killed = self._settings, self._known.phases[row] == KILLED
        keeps_m_s = self._known.velocity_m_s[row : row + 1]
        if not killed:
            _, keeps_m_s = self._kept.possible_m_s(np.array([row]), self._known.velocity_m_s)
        drift_s = self._drift_s(np.full(len(keeps_m_s), row), keeps_m_s)
        parts = [
            swept_segments_m(
                self._known.position_m[row],
                each_m_s,
                self._home_of(row),
                "land" if killed else self._alone.vehicles[row].action,
                alone.return_heights_m.get(self._ids[row], RETURN_HEIGHT_M),
                climbing_to_m=None if killed else alone.takeoff_height_m,
                drift_s=each_s,
            )
            for each_m_s, each_s in zip(keeps_m_s, drift_s.tolist(), strict=True)
        ]
        return np.concatenate(parts)

    def _drift_s(self, rows: NDArray[np.intp], velocity_m_s: Array) -> Array:
        """(p,) how long vehicles without commands may keep (p, 3) velocities, their stop included."""
        alone = self._alone
        return self._settings.watchdog_s + alone.flies_on_s[rows] + alone.stop_s(rows, velocity_m_s)

    def _home_of(self, row: int) -> Array | None:
        home_m: Array = self._home_m[row]
        return home_m if np.isfinite(home_m).all() else None
