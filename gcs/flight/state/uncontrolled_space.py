"""The space closed to others by vehicles that are silent, lost or killed, from where each was seen last."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.config.schema import Config
from gcs.control import Memory
from gcs.flight.state.vehicle import Vehicle
from gcs.model.lifecycle import AIRBORNE, Phase
from gcs.model.setpoint_loss import FleetWithoutSetpoints
from gcs.model.state import Array, Mask
from gcs.planning.lost_space import KeptSetpoints, expected_drift, swept_segments_m
from gcs.planning.silent_space import silent_segments_m

Rows = NDArray[np.intp]

_LOST: Final = frozenset({Phase.LOST, Phase.KILLED})
_NOWHERE: Final = np.full(3, np.nan)


class UncontrolledSpace:
    """Last known positions and velocities of n vehicles, and the paths that these may take without control.

    Attributes:
        seen_m, seen_m_s: (n, 3) last known positions and velocities, show frame; NaN: none.
        without_setpoints: what each vehicle does by itself.
    """

    def __init__(self, config: Config, vehicles: Sequence[Vehicle]) -> None:
        """`vehicles` (n,) by row."""
        self._config, self._vehicles = config, vehicles
        self.without_setpoints = FleetWithoutSetpoints([each.without_setpoints for each in vehicles])
        self.seen_m: Array = np.full((len(vehicles), 3), np.nan)
        self.seen_m_s: Array = self.seen_m.copy()
        self._kept = KeptSetpoints(len(vehicles))
        self._swept: dict[int, tuple[bytes, Array]] = {}  # by row, with all that it follows from

    def note_seen(self, rows: Mask, position_m: Array, velocity_m_s: Array) -> None:
        """Take the (n, 3) positions and velocities of some rows (n,) as the last known."""
        np.copyto(self.seen_m, position_m, where=rows[:, None])
        np.copyto(self.seen_m_s, velocity_m_s, where=rows[:, None])

    def last_m(self, vehicle: Vehicle) -> Array | None:
        """(3,) Last known position, show frame; None if there is none, or it was forgotten."""
        place_m: Array = self.seen_m[vehicle.row]
        return place_m if np.isfinite(place_m).all() else None

    def forget_seen(self, vehicle: Vehicle) -> None:
        """Forget the last known position: the vehicle is not there any more."""
        self.seen_m[vehicle.row] = np.nan

    def note_setpoints(self, memory: Memory, sample_age_s: Array, now_s: float) -> None:
        """Begin a tick: see `KeptSetpoints.note`, and `Table.sample_age_s` for (n,) the ages."""
        n = len(self._vehicles)
        self._kept.note(memory.desired_m_s[:n], memory.setpoint_m_s[:n], sample_age_s, now_s)

    def silent(self, age_s: Array, age_max_s: float) -> Rows:
        """(k,) Airborne vehicles without commands because their positions (n,) are too old, not lost yet."""
        late = ((age_s > age_max_s) & np.isfinite(self.seen_m[:, 0])).nonzero()[0]
        if len(late) == 0:
            return late
        return late[[self._vehicles[row].phase in AIRBORNE for row in late.tolist()]]

    def near_m(self, silent: Rows, sample_age_s: Array) -> tuple[Array, Rows]:
        """(m, 2, 3) paths that silent vehicles (k,) may take soon, and (m,) the row of each.

        A late position still says where a vehicle was, and how fast: `sample_age_s` (n,), of `Table`.
        """
        operation = self._config.operation
        of, keeps_m_s = self._kept.possible_m_s(silent, self.seen_m_s)
        home_m = np.full_like(self.seen_m, np.nan)
        if len(silent):
            homes = [self._vehicles[row].home_m for row in silent.tolist()]
            home_m[silent] = np.concatenate([_NOWHERE if each is None else each for each in homes]).reshape(
                -1, 3
            )
        segments_m, rows = silent_segments_m(
            self.seen_m[of],
            keeps_m_s,
            home_m[of],
            self._returns_at_m[of],
            np.minimum(sample_age_s[of], operation.silence_s),
            action=np.where(self._holds[of], "hold", self.without_setpoints.action[of]),
            noticed_s=self._flies_on_s[of],
            drift_s=self._drift_s(of, keeps_m_s),
        )
        return segments_m, of[rows]

    def swept(self, age_s: Array) -> tuple[Array, Rows]:
        """(m, 2, 3) paths that lost vehicles may take, and (m,) the row of each.

        Also of those that land while their positions are not believed: they are no longer where they report.

        Args:
            age_s: (n,) of the newest positions, inf: not believed.
        """
        blind = np.isinf(age_s)
        swept = {
            vehicle.row: self._swept_m(vehicle)
            for vehicle in self._vehicles
            if (vehicle.phase in _LOST or (blind[vehicle.row] and vehicle.phase is Phase.LANDING))
            and np.isfinite(self.seen_m[vehicle.row]).all()
        }
        rows = np.repeat(np.array([*swept], dtype=np.intp), [len(own_m) for own_m in swept.values()])
        return np.concatenate([np.zeros((0, 2, 3)), *swept.values()]), rows

    def drift(self, silent: Rows, sample_age_s: Array) -> tuple[Array, Array]:
        """As of `Tasks`: of silent vehicles and of lost ones. `sample_age_s` (n,): of `Table`."""
        drifts = np.array([vehicle.phase is Phase.LOST for vehicle in self._vehicles], dtype=np.bool_)
        drifts[silent] = True
        alone, keeps_m_s = self.without_setpoints, self._kept.expected_m_s(self.seen_m_s)
        stop_s = alone.stop_s(np.arange(len(drifts)), keeps_m_s)
        noticed_s = self._flies_on_s
        about = self.seen_m, keeps_m_s, sample_age_s, drifts
        return expected_drift(*about, noticed_s=noticed_s, stop_s=stop_s)

    @property
    def _holds(self) -> Mask:
        """(n,) which a command has stopped already."""
        return np.array([vehicle.phase is Phase.HOLD for vehicle in self._vehicles], dtype=np.bool_)

    @property
    def _flies_on_s(self) -> Array:
        """(n,) how long each flies on without setpoints; 0: its autopilot stops it on a command."""
        commanded = [vehicle.phase is Phase.HOLD or vehicle.flags.handed_over for vehicle in self._vehicles]
        return np.where(commanded, 0.0, self.without_setpoints.flies_on_s)

    @property
    def _returns_at_m(self) -> Array:
        """(n,) heights at which they return by themselves."""
        return self.without_setpoints.returns_at_m(self._config.return_heights_m)

    def _drift_s(self, rows: Rows, velocity_m_s: Array) -> Array:
        """(p,) how long vehicles without commands may keep (p, 3) velocities, their stop included."""
        alone = self.without_setpoints
        drift_s: Array = alone.flies_on_s[rows] + alone.stop_s(rows, velocity_m_s)
        return self._config.setpoint_timeout_s + drift_s

    def _swept_m(self, vehicle: Vehicle) -> Array:
        """(m, 2, 3) of one vehicle; computed again when it was seen, sent home or killed meanwhile."""
        operation, row = self._config.operation, vehicle.row
        killed, comes_down = vehicle.phase is Phase.KILLED, vehicle.phase is not Phase.LOST
        keeps_m_s = self.seen_m_s[row : row + 1]
        if not killed:
            _, keeps_m_s = self._kept.possible_m_s(np.array([row]), self.seen_m_s)
        home_m = _NOWHERE if vehicle.home_m is None else vehicle.home_m
        drift_s = self._drift_s(np.full(len(keeps_m_s), row), keeps_m_s)
        places = self.seen_m[row], keeps_m_s, home_m, drift_s, self._returns_at_m[row]
        action = "land" if comes_down else vehicle.without_setpoints.action
        key = b"".join((*(each.tobytes() for each in places), bytes([killed, comes_down]), action.encode()))
        before = self._swept.get(row)
        if before is not None and before[0] == key:
            return before[1]
        paths_m = [
            swept_segments_m(
                self.seen_m[row],
                each_m_s,
                vehicle.home_m,
                action,
                float(self._returns_at_m[row]),
                climbing_to_m=None if comes_down else operation.takeoff_height_m,
                drift_s=each_s,
            )
            for each_m_s, each_s in zip(keeps_m_s, drift_s.tolist(), strict=True)
        ]
        self._swept[row] = key, np.concatenate(paths_m)
        return self._swept[row][1]
