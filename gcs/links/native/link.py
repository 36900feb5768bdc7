"""The link for large fleets: frames of the whole fleet are written and read at once, without MAVSDK.

Setpoints leave in `send` only, so nothing repeats them: when the ticks end, the setpoints end.
"""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import numpy as np

from gcs.links.batch_link import Coroutines, Link
from gcs.links.command_protocol import CommandProtocol
from gcs.links.native.commands import Commands, NativeCommandChannel
from gcs.links.sender import SetpointBatch
from gcs.mavlink.codec import SYSTEM_ID, setpoint_messages
from gcs.mavlink.framing import SET_POSITION_TARGET_LOCAL_NED
from gcs.model.state import Mask


class NativeLink(Link):
    """Up to 250 vehicles, without MAVSDK. A `gcs.links.Link`. Used on the loop's thread only."""

    def _own_id(self) -> int:
        return SYSTEM_ID

    def _prepare(self) -> None:
        self._commands = Commands(self._system_ids, self._send_message)
        self._all: Mask = np.ones(len(self.ids), np.bool_)

    @asynccontextmanager
    async def _opened(self) -> AsyncIterator[Coroutines]:
        protocol = CommandProtocol(self._vehicles, self._latch, self._clock)
        async with self._parts_open():
            self._commands = self._inbox.commands = Commands(self._system_ids, self._send_message)
            self._protocol = protocol
            try:
                yield {}
            finally:
                self._protocol, self._inbox.commands = None, None
                protocol.close()
                self._commands.close()

    def _send_setpoints(self, desired: SetpointBatch) -> None:
        rows, now_s = desired.rows, self._clock()
        if not len(rows):
            return
        messages = setpoint_messages(
            self._system_ids[rows], desired.velocity_ned_m_s, desired.yaw_rad, time_s=now_s
        )
        frames = self._outbox.encode(SET_POSITION_TARGET_LOCAL_NED, messages, rows)
        left = self._outbox.send(frames, rows, now_s, until_s=desired.until_s)
        left_s = self._clock()  # after the call: never earlier than the datagrams
        if left_s > desired.until_s:
            self.counters.setpoints_dropped += int((~left).sum())
        self._sent.note(rows[left], left_s)
        self.counters.setpoints_sent += int(left.sum())

    def _command_channel(self, row: int, otherwise: str) -> NativeCommandChannel:
        if not np.isfinite(self._telemetry.heartbeat_time_s[row]):
            raise self._never_connected(row, otherwise)
        return NativeCommandChannel(row, self._commands)

    def _forget_commands(self, row: int) -> None:
        self.counters.commands_dropped += self._commands.fail(lambda other: other == row, "killed meanwhile")

    def _commandable(self) -> Mask:
        return self._all

    def _is_awaiting(self) -> bool:
        return self._commands.awaited

    def _move_bytes(self) -> None:
        """All leaves as it is written."""
