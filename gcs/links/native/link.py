"""The link for large fleets: frames of the whole fleet are written and read at once, without MAVSDK.

Setpoints leave in `send` only, so nothing repeats them: when the ticks end, the setpoints end.
"""

from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from time import monotonic

import numpy as np

from gcs.links.batch_link import BatchLink, Coroutines
from gcs.links.command_protocol import CommandProtocol
from gcs.links.endpoints.ports import Ports
from gcs.links.native.commands import Commands, NativeCommandChannel
from gcs.links.sender import SetpointBatch
from gcs.links.settings import Forward, Place
from gcs.links.signing import Signing
from gcs.mavlink.codec import SYSTEM_ID, setpoint_messages
from gcs.mavlink.framing import SET_POSITION_TARGET_LOCAL_NED
from gcs.model.frames import ShowFrame
from gcs.model.state import Mask, VehicleId


class NativeLink(BatchLink):
    """Up to 250 vehicles, without MAVSDK. A `gcs.links.Link`. Used on the loop's thread only."""

    def __init__(
        self,
        name: str,
        vehicles: Mapping[VehicleId, int],
        places: Place | Sequence[Place],
        frame: ShowFrame,
        *,
        setpoint_timeout_s: float = 0.2,
        heartbeat_hold_s: float = 3.0,
        rates_hz: Mapping[int, float] | None = None,
        record: Path | None = None,
        signing: Signing | None = None,
        forward: Sequence[Forward] = (),
        clock: Callable[[], float] = monotonic,
        ports: Ports | None = None,
    ) -> None:
        """See `BatchLink`."""
        super().__init__(
            name,
            vehicles,
            places,
            frame,
            station_id=SYSTEM_ID,
            setpoint_timeout_s=setpoint_timeout_s,
            heartbeat_hold_s=heartbeat_hold_s,
            rates_hz=rates_hz,
            record=record,
            signing=signing,
            forward=forward,
            clock=clock,
            ports=ports,
        )
        self._commands = Commands(self._system_ids, self._send_message)
        self._all: Mask = np.ones(len(self._ids), np.bool_)

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
            self._counters.setpoints_dropped += int((~left).sum())
        self._sent.note(rows[left], left_s)
        self._counters.setpoints_sent += int(left.sum())

    def _command_channel(self, row: int, otherwise: str) -> NativeCommandChannel:
        reported = self._telemetry.reported(row)
        if not np.isfinite(reported.heartbeat_time_s):
            raise self._never_connected(row, otherwise)
        return NativeCommandChannel(row, self._commands, reported)

    def _forget_commands(self, row: int) -> None:
        self._counters.commands_dropped += self._commands.fail(lambda other: other == row, "killed meanwhile")

    def _commandable(self) -> Mask:
        return self._all

    def _is_awaiting(self) -> bool:
        return self._commands.awaited

    def _move_bytes(self) -> None:
        """All leaves as it is written."""
