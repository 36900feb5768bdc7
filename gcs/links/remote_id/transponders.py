"""What the transponders of one link's vehicles report: heartbeats, and whether one may arm. No I/O."""

from dataclasses import dataclass, field
from math import isfinite
from typing import Final

import numpy as np

from gcs.links.listening import FrameListener
from gcs.links.remote_id.messages import ARM_STATUS, TRANSPONDER_TYPE, TRANSPONDERS
from gcs.mavlink import codec
from gcs.mavlink.framing import HEARTBEAT
from gcs.mavlink.kernels import MESSAGE, Bytes, Whole
from gcs.model.state import Array

SILENT_S: Final = 3.0
"""As long as ArduPilot believes ARM_STATUS."""

READY_STATES: Final = frozenset({3, 4})  # MAV_STATE_STANDBY and _ACTIVE, by which PX4 judges it
GOOD: Final = 0  # MAV_ODID_ARM_STATUS_GOOD_TO_ARM
ERROR_MAX: Final = 50


@dataclass(eq=False)
class Transponders:
    """Rows as on the link.

    Attributes:
        beat_s, status_s: (n,) arrival of the newest heartbeat, and ARM_STATUS; -inf: none.
    """

    count: int
    beat_s: Array = field(init=False)
    status_s: Array = field(init=False)

    def __post_init__(self) -> None:
        self.beat_s, self.status_s = np.full(self.count, -np.inf), np.full(self.count, -np.inf)
        self._state = np.zeros(self.count, np.int64)
        self._status = np.full(self.count, -1, np.int64)
        self._error = [""] * self.count

    @property
    def listener(self) -> FrameListener:
        """What reads their messages."""
        return FrameListener(TRANSPONDERS, (HEARTBEAT, ARM_STATUS), self._take)

    def _take(self, data: Bytes, frames: Whole, rows: Whole, time_s: Array) -> None:
        for at in np.flatnonzero(frames[:, MESSAGE] == HEARTBEAT).tolist():
            beat = codec.decode(HEARTBEAT, data, frames[at : at + 1])[0]
            if int(beat["type"]) == TRANSPONDER_TYPE:
                self.beat_s[rows[at]], self._state[rows[at]] = time_s[at], beat["system_status"]
        for at in np.flatnonzero(frames[:, MESSAGE] == ARM_STATUS).tolist():
            status = codec.decode(ARM_STATUS, data, frames[at : at + 1])[0]
            row = int(rows[at])
            self.status_s[row], self._status[row] = time_s[at], status["status"]
            self._error[row] = "".join(filter(str.isprintable, codec.text(status["error"])))[:ERROR_MAX]

    def problem(self, row: int, now_s: float) -> str:
        """Why a vehicle's transponder is not ready, in words; empty: it is."""
        newest_s = max(float(self.beat_s[row]), float(self.status_s[row]))
        if not isfinite(newest_s):
            return "its transponder was never received"
        if now_s - newest_s > SILENT_S:
            return f"its transponder is silent for {now_s - newest_s:.0f} s"
        if now_s - self.status_s[row] <= SILENT_S and self._status[row] != GOOD:
            return f'its transponder is not ready: "{self._error[row] or "no reason is given"}"'
        beats = now_s - self.beat_s[row] <= SILENT_S
        if beats and int(self._state[row]) not in READY_STATES:
            return f"its transponder is in state {int(self._state[row])}, neither on standby nor active"
        return ""
