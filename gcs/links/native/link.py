"""The link for large fleets: frames of the whole fleet are written and read at once, without MAVSDK.

Setpoints leave in `send` only, so nothing repeats them: when the ticks end, the setpoints end.
"""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import numpy as np

from gcs.links.batch_link import Coroutines, Link
from gcs.links.command_protocol import CommandProtocol
from gcs.links.own_commands import OwnCommandChannel, OwnCommands
from gcs.links.sender import SetpointBatch
from gcs.mavlink import codec


class NativeLink(Link):
    """Up to 250 vehicles, without MAVSDK. A `gcs.links.Link`. Used on the loop's thread only."""

    def _own_id(self) -> int:
        return codec.SYSTEM_ID

    def _prepare(self) -> None:
        self._begin_commands()

    def _begin_commands(self) -> None:
        self._commands = OwnCommands(
            self._system_ids, self._telemetry.autopilots, self._send_message, self._station_id
        )
        self._inbox.take_acks, self._inbox.take_value = self._commands.take_acks, self._commands.take_value

    @asynccontextmanager
    async def _opened(self) -> AsyncIterator[Coroutines]:
        protocol = CommandProtocol(self._vehicles, self._latch, self._clock)
        async with self._parts_open():
            self._begin_commands()
            self._protocol = protocol
            try:
                yield {}
            finally:
                self._protocol = None
                protocol.close()
                self._commands.close()

    def _expect_setpoints(self, batch: SetpointBatch) -> None:
        """Encode them all at once; nothing leaves but what `_send_setpoints` is given."""
        about = batch.rows, batch.velocity_ned_m_s, batch.yaw_rad
        self._expected = self.outbox.encode_setpoints(*about, time_s=self._clock())

    def _send_setpoints(self, desired: SetpointBatch) -> None:
        rows, now_s = desired.rows, self._clock()
        if not len(rows):
            return
        frames, self._expected = self._expected.cut(len(rows))
        left = self.outbox.send(frames, rows, now_s, until_s=desired.until_s)
        left_s, count = self._clock(), int(np.count_nonzero(left))  # never earlier than the datagrams
        if left_s > desired.until_s:
            self.counters.setpoints_dropped += len(left) - count
        self._sent.note(rows[left], left_s)
        self.counters.setpoints_sent += count

    def _command_channel(self, row: int, otherwise: str) -> OwnCommandChannel:
        if not np.isfinite(self._telemetry.heartbeat_time_s[row]):
            raise self._never_connected(row, otherwise)
        return OwnCommandChannel(row, self._commands)

    def _forget_commands(self, row: int) -> None:
        self.counters.commands_dropped += self._commands.fail(lambda other: other == row, "killed meanwhile")

    def _is_awaiting(self) -> bool:
        return self._commands.awaited

    def _move_bytes(self) -> None:
        """All leaves as it is written."""
