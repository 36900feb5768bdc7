"""MAVSDK's output, before it leaves: setpoints are checked and sent together, other frames one by one."""

from collections.abc import Callable
from dataclasses import InitVar, dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.links.command_protocol import KillLatch
from gcs.links.endpoints.mmsg import Batch
from gcs.links.link import Counters
from gcs.links.sender import Outbox, SentSetpoints, SetpointBatch
from gcs.mavlink.codec import Frames, split, target_system
from gcs.mavlink.framing import SETPOINT_MESSAGES, Frame, moves
from gcs.mavlink.kernels import Whole
from gcs.mavlink.setpoints import NO_ROW, SETPOINT_FRAME, are_setpoints, awaited_setpoints
from gcs.model.state import Mask

_ALL: Final = slice(None)


@dataclass(eq=False)
class SetpointFilter:
    """Passes one setpoint a tick for each vehicle: that of the newest tick, while it may leave.

    MAVSDK repeats setpoints by itself, and has a queue: what it writes may be a repetition, or old.
    """

    outbox: Outbox
    system_ids: InitVar[Whole]
    latch: KillLatch
    sent: SentSetpoints
    counters: Counters
    clock: Callable[[], float]

    def __post_init__(self, system_ids: Whole) -> None:
        n = len(system_ids)
        self._row_of = np.full(256, NO_ROW, np.int64)
        self._row_of[system_ids] = np.arange(n)
        self._awaited: Mask = np.zeros(n, np.bool_)  # the setpoint of the newest tick has still to leave
        self._velocity: NDArray[np.uint32] = np.zeros((n, 3), np.uint32)  # as the frame contains it
        self._until_s = -np.inf

    def awaits(self, rows: Whole | slice = _ALL) -> bool:
        """Whether a setpoint of the newest tick has still to leave to one of these rows."""
        return bool(self._awaited[rows].any())

    def expect(self, desired: SetpointBatch) -> None:
        """Let these setpoints leave, once each, and no earlier ones."""
        self._awaited[:] = False
        self._awaited[desired.rows] = True
        self._velocity[desired.rows] = desired.velocity_ned_m_s.astype(np.float32).view(np.uint32)
        self._until_s = desired.until_s

    def forbid(self, rows: Whole | slice) -> None:
        """Let no setpoint of the newest tick leave to these rows any more."""
        self._awaited[rows] = False

    def take(self, written: Batch, count: int) -> None:
        """Send those of the first `count` datagrams that may leave. Never blocks, never raises."""
        is_setpoint = are_setpoints(written.data, written.length, count)
        if is_setpoint.any():
            self._take_setpoints(written, is_setpoint)
        others = [
            (frame, int(self._row_of[target_system(frame)]))
            for at in np.flatnonzero(~is_setpoint).tolist()
            for frame in split(written.data[at, : written.length[at]].tobytes()).frames
            if self._may_leave(frame)
        ]
        if others:
            rows = np.array([row for _, row in others])
            self.outbox.send_raw([frame.raw for frame, _ in others], rows, self.clock())

    def _take_setpoints(self, written: Batch, setpoints: Mask) -> None:
        at, leaving = awaited_setpoints(written.data, setpoints, self._row_of, self._awaited, self._velocity)
        frames = Frames(
            written.data[at, : SETPOINT_FRAME.itemsize], np.full(len(at), SETPOINT_FRAME.itemsize)
        )
        left = self.outbox.send(frames, leaving, self.clock(), until_s=self._until_s)
        left_s = self.clock()  # after the call: never earlier than the datagrams
        self._awaited[leaving] = False
        self.sent.note(leaving[left], left_s)
        self.counters.setpoints_sent += int(left.sum())
        self.counters.setpoints_dropped += int(setpoints.sum()) - len(leaving)
        if left_s > self._until_s:
            self.counters.setpoints_dropped += int((~left).sum())

    def _may_leave(self, frame: Frame) -> bool:
        """Whether a frame may leave: commands and parameters, but no broadcast; the link beats by itself."""
        target = target_system(frame)
        if target == 0:
            return False
        if self._row_of[target] == NO_ROW:
            self.counters.unroutable += 1
        elif frame.message_id in SETPOINT_MESSAGES:
            self.counters.setpoints_dropped += 1
        elif self.latch.is_shut(target) and moves(frame):
            self.counters.commands_dropped += 1
        else:
            return True
        return False
