"""The link for large fleets: frames of the whole fleet are written and read at once, without MAVSDK.

Setpoints leave in `send` only, so nothing repeats them: when the ticks end, the setpoints end. Commands and
parameters are MAVLink for PX4, and tasks of the loop, no threads.
"""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from math import nan
from typing import Final, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import development as dialect

from gcs.links.batch_link import Coroutines, Link
from gcs.links.command_protocol import CLOSED, TIMEOUT, CommandProtocol
from gcs.links.link import Command, ParameterValue, Verb
from gcs.links.sender import SetpointBatch
from gcs.mavlink import codec
from gcs.mavlink.codec import Records, addressed
from gcs.mavlink.framing import COMMAND_LONG, SET_POSITION_TARGET_LOCAL_NED
from gcs.mavlink.kernels import Whole
from gcs.model.errors import CommandError

PARAM_REQUEST_READ: Final = 20
PARAM_SET: Final = 23

ANSWER_S: Final = 0.5
TRIES: Final = 4
LONGEST_S: Final = 10.0
"""Longest time for an answer after IN_PROGRESS."""

_NAME_LENGTH: Final = 16
_IN_PROGRESS: Final = int(dialect.MAV_RESULT_IN_PROGRESS)
_FAILURES: Final = {
    int(dialect.MAV_RESULT_TEMPORARILY_REJECTED): "COMMAND_REJECTED_FOR_NOW",
    int(dialect.MAV_RESULT_DENIED): "COMMAND_DENIED",
    int(dialect.MAV_RESULT_UNSUPPORTED): "COMMAND_UNSUPPORTED",
    int(dialect.MAV_RESULT_FAILED): "COMMAND_FAILED",
    6: "COMMAND_CANCELLED",
}

SET_MODE: Final = int(dialect.MAV_CMD_DO_SET_MODE)
TAKEOFF: Final = int(dialect.MAV_CMD_NAV_TAKEOFF)
LAND: Final = int(dialect.MAV_CMD_NAV_LAND)
TAKEOFF_HEIGHT: Final = "MIS_TAKEOFF_ALT"

_CUSTOM: Final = float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
_FROM_HERE: Final = (nan,) * 7  # at its position, with the configured parameters

_COMMANDS: Final[dict[Verb, tuple[int, tuple[float, ...]]]] = {
    Verb.ARM: (codec.ARM_DISARM, (1.0,)),
    Verb.DISARM: (codec.ARM_DISARM, (0.0,)),
    Verb.TAKEOFF: (TAKEOFF, _FROM_HERE),
    Verb.HOLD: (SET_MODE, (_CUSTOM, 4.0, 3.0)),
    Verb.OFFBOARD: (SET_MODE, (_CUSTOM, 6.0, 0.0)),
    Verb.RETURN: (SET_MODE, (_CUSTOM, 4.0, 5.0)),
    Verb.LAND: (LAND, _FROM_HERE),
}
"""PX4's main and sub mode where a mode is set."""

Gate = Callable[[], None]
"""Called before anything leaves; raises CommandError when it may not."""


class Answer(NamedTuple):
    """A command's result, or a parameter's value."""

    result: int = 0
    value: ParameterValue = 0


@dataclass(eq=False)
class Commands:
    """Repeats commands until they are answered, matching answers by vehicle and command (or parameter).

    At most one of a kind at a time for each vehicle: a second waits for the first.
    """

    system_ids: Whole
    send: Callable[[int, Records, Whole], object]

    def __post_init__(self) -> None:
        self._closed = False
        self._pending: dict[tuple[int, int | str], asyncio.Future[Answer]] = {}
        self._locks: dict[tuple[int, int | str], asyncio.Lock] = {}

    @property
    def awaited(self) -> bool:
        return bool(self._pending)

    def close(self) -> None:
        """Send nothing more; all waiting calls fail."""
        self._closed = True
        self.fail(lambda _row: True, CLOSED)

    def fail(self, which: Callable[[int], bool], reason: str) -> int:
        """End what is under way with these rows. Returns: number of calls ended."""
        ended = [key for key, waiting in self._pending.items() if which(key[0]) and not waiting.done()]
        for key in ended:
            self._pending[key].set_exception(CommandError(reason))
        return len(ended)

    async def command(self, row: int, command: int, values: tuple[float, ...], may_leave: Gate) -> None:
        """Send a COMMAND_LONG until answered. Raises: CommandError named after its answer, or TIMEOUT."""
        params = {f"param{number}": value for number, value in enumerate(values, 1)}
        message = addressed(COMMAND_LONG, self.system_ids[[row]], command=command, **params)
        answer = await self._request((row, command), COMMAND_LONG, message, may_leave)
        if answer.result:
            raise CommandError(_FAILURES.get(answer.result, f"COMMAND_RESULT_{answer.result}"))

    async def get_parameter(self, row: int, name: str, may_leave: Gate) -> ParameterValue:
        """A parameter's value. Raises: CommandError, TIMEOUT for one that the vehicle does not have."""
        text = codec.text_field(name, _NAME_LENGTH)
        message = addressed(PARAM_REQUEST_READ, self.system_ids[[row]], param_index=-1, param_id=text)
        return (await self._request((row, name), PARAM_REQUEST_READ, message, may_leave)).value

    async def set_parameter(self, row: int, name: str, value: ParameterValue, may_leave: Gate) -> None:
        """Set a parameter: integers stay integers, encoded bytewise, as PX4 requires.

        Raises: CommandError when the vehicle answers with another value, or not at all.
        """
        bits = np.array([value], np.int32).view(np.float32) if isinstance(value, int) else value
        fields = {"param_id": codec.text_field(name, _NAME_LENGTH), "param_value": bits}
        fields["param_type"] = codec.INT32 if isinstance(value, int) else codec.FLOAT
        message = addressed(PARAM_SET, self.system_ids[[row]], **fields)
        reported = (await self._request((row, name), PARAM_SET, message, may_leave)).value
        if reported != (value if isinstance(value, int) else float(np.float32(value))):
            raise CommandError(f"the vehicle reports {reported:g}")

    def take_acks(self, rows: Whole, reported: Records) -> None:
        """Read COMMAND_ACKs: (k,) rows and messages, in order of arrival."""
        for row, command, result in zip(
            rows.tolist(), reported["command"].tolist(), reported["result"].tolist(), strict=True
        ):
            self._resolve((row, command), Answer(result))

    def take_values(self, rows: Whole, reported: Records) -> None:
        for row, (name, value) in zip(rows.tolist(), codec.parameter_values(reported), strict=True):
            self._resolve((row, name), Answer(value=value))

    def _resolve(self, key: tuple[int, int | str], answer: Answer) -> None:
        waiting = self._pending.get(key)
        if waiting is not None and not waiting.done():
            waiting.set_result(answer)

    async def _request(
        self, key: tuple[int, int | str], message_id: int, message: Records, may_leave: Gate
    ) -> Answer:
        """Send until there is an answer; `key` has the row. Raises: CommandError."""
        loop, rows = asyncio.get_running_loop(), np.array([key[0]])
        async with self._locks.setdefault(key, asyncio.Lock()):
            may_leave()
            give_up_s = loop.time() + LONGEST_S
            attempt, patient = 0, False
            while attempt < TRIES and loop.time() < give_up_s:
                if self._closed:
                    raise CommandError(CLOSED)
                waiting: asyncio.Future[Answer] = loop.create_future()
                self._pending[key] = waiting
                if message_id == COMMAND_LONG:
                    message["confirmation"] = attempt
                if not patient:
                    self.send(message_id, message, rows)
                try:
                    async with asyncio.timeout(LONGEST_S if patient else ANSWER_S):
                        answer = await waiting
                except TimeoutError:
                    attempt += 1
                    continue
                finally:
                    del self._pending[key]
                if answer.result != _IN_PROGRESS:
                    return answer
                patient = True
        raise CommandError(TIMEOUT)


@dataclass(frozen=True, slots=True)
class NativeCommandChannel:
    """One vehicle. A `gcs.links.command_protocol.CommandChannel`."""

    row: int
    commands: Commands

    async def command(self, given: Command, may_leave: Callable[[], None]) -> None:
        if given.verb is Verb.TAKEOFF:
            await self.commands.set_parameter(self.row, TAKEOFF_HEIGHT, float(given.height_m), may_leave)
        command, values = _COMMANDS[given.verb]
        await self.commands.command(self.row, command, values, may_leave)

    async def parameter(self, name: str) -> ParameterValue:
        return await self.commands.get_parameter(self.row, name, _moves_nothing)

    async def set_parameter(self, name: str, value: ParameterValue) -> None:
        await self.commands.set_parameter(self.row, name, value, _moves_nothing)


def _moves_nothing() -> None:
    """Parameters may also be read and set after a kill."""


class NativeLink(Link):
    """Up to 250 vehicles, without MAVSDK. A `gcs.links.Link`. Used on the loop's thread only."""

    def _own_id(self) -> int:
        return codec.SYSTEM_ID

    def _prepare(self) -> None:
        self._frames = codec.joined(())  # of the setpoints that have not left yet
        self._begin_commands()

    def _begin_commands(self) -> None:
        self._commands = Commands(self._system_ids, self._send_message)
        self._inbox.take_acks, self._inbox.take_values = self._commands.take_acks, self._commands.take_values

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
        messages = codec.setpoint_messages(
            self._system_ids[batch.rows], batch.velocity_ned_m_s, batch.yaw_rad, time_s=self._clock()
        )
        self._frames = self._outbox.encode(SET_POSITION_TARGET_LOCAL_NED, messages, batch.rows)

    def _send_setpoints(self, desired: SetpointBatch) -> None:
        rows, now_s = desired.rows, self._clock()
        if not len(rows):
            return
        data, length = self._frames
        frames = codec.Frames(data[: len(rows)], length[: len(rows)])
        self._frames = codec.Frames(data[len(rows) :], length[len(rows) :])
        left = self._outbox.send(frames, rows, now_s, until_s=desired.until_s)
        left_s, count = self._clock(), int(np.count_nonzero(left))  # never earlier than the datagrams
        if left_s > desired.until_s:
            self.counters.setpoints_dropped += len(left) - count
        self._sent.note(rows[left], left_s)
        self.counters.setpoints_sent += count

    def _command_channel(self, row: int, otherwise: str) -> NativeCommandChannel:
        if not np.isfinite(self._telemetry.heartbeat_time_s[row]):
            raise self._never_connected(row, otherwise)
        return NativeCommandChannel(row, self._commands)

    def _forget_commands(self, row: int) -> None:
        self.counters.commands_dropped += self._commands.fail(lambda other: other == row, "killed meanwhile")

    def _is_awaiting(self) -> bool:
        return self._commands.awaited

    def _move_bytes(self) -> None:
        """All leaves as it is written."""
