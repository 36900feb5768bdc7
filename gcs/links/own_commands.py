"""Our own commands and parameters, repeated until they are answered: tasks of the loop, no threads."""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import development as dialect

from gcs.links.autopilots import Autopilot, CommandLong
from gcs.links.command_protocol import CLOSED, TIMEOUT
from gcs.links.link import Command, ParameterValue
from gcs.mavlink import codec
from gcs.mavlink.codec import Records, addressed
from gcs.mavlink.framing import COMMAND_LONG
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

Gate = Callable[[], None]
"""Called before anything leaves; raises CommandError when it may not."""


class CommandAnswer(NamedTuple):
    """A command's result, or a parameter's value."""

    result: int = 0
    value: ParameterValue = 0


@dataclass(eq=False)
class OwnCommands:
    """Repeats commands until they are answered, matching answers by vehicle and command (or parameter).

    At most one of a kind at a time for each vehicle: a second waits for the first.
    """

    system_ids: Whole
    autopilots: Sequence[Autopilot]  # (n,)
    send: Callable[[int, Records, Whole], object]
    station_id: int = codec.SYSTEM_ID  # of the sender: answers to it count, as to its component
    component_id: int = codec.COMPONENT_ID

    def __post_init__(self) -> None:
        self._closed = False
        self._pending: dict[tuple[int, int | str], asyncio.Future[CommandAnswer]] = {}
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
        """Set a parameter; an int only where the autopilot holds an integer.

        Raises: CommandError when the vehicle answers with another value, or not at all.
        """
        raw, kind = self.autopilots[row].encoded(value)
        text = codec.text_field(name, _NAME_LENGTH)
        message = addressed(
            PARAM_SET, self.system_ids[[row]], param_id=text, param_value=raw, param_type=kind
        )
        desired = value if isinstance(value, int) else float(np.float32(value))
        reported = (await self._request((row, name), PARAM_SET, message, may_leave)).value
        if reported != desired:  # a PARAM_VALUE names no receiver: it may answer another station
            with suppress(CommandError):
                reported = (await self._request((row, name), PARAM_SET, message, may_leave)).value
        if reported != desired:
            raise CommandError(f"the vehicle reports {reported:g}")

    def take_acks(self, rows: Whole, reported: Records) -> None:
        """Read COMMAND_ACKs: (k,) rows and messages, in order of arrival; also those to other stations."""
        ours = codec.answers(reported, self.station_id, self.component_id)
        rows, reported = rows[ours], reported[ours]
        for row, command, result in zip(
            rows.tolist(), reported["command"].tolist(), reported["result"].tolist(), strict=True
        ):
            self._resolve((row, command), CommandAnswer(result))

    def take_value(self, row: int, name: str, value: ParameterValue) -> None:
        self._resolve((row, name), CommandAnswer(value=value))

    def _resolve(self, key: tuple[int, int | str], answer: CommandAnswer) -> None:
        waiting = self._pending.get(key)
        if waiting is not None and not waiting.done():
            waiting.set_result(answer)

    async def _request(
        self, key: tuple[int, int | str], message_id: int, message: Records, may_leave: Gate
    ) -> CommandAnswer:
        """Send until there is an answer; `key` has the row. Raises: CommandError."""
        loop, rows = asyncio.get_running_loop(), np.array([key[0]])
        async with self._locks.setdefault(key, asyncio.Lock()):
            may_leave()
            give_up_s = loop.time() + LONGEST_S
            attempt, patient = 0, False
            while attempt < TRIES and loop.time() < give_up_s:
                if self._closed:
                    raise CommandError(CLOSED)
                waiting: asyncio.Future[CommandAnswer] = loop.create_future()
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
class OwnCommandChannel:
    """One vehicle. A `gcs.links.command_protocol.CommandChannel`."""

    row: int
    commands: OwnCommands

    async def command(self, given: Command, may_leave: Gate) -> None:
        for step in self.commands.autopilots[self.row].steps(given):
            if isinstance(step, CommandLong):
                await self.commands.command(self.row, step.command, step.params, may_leave)
            else:
                await self.commands.set_parameter(self.row, step.name, step.value, may_leave)

    async def parameter(self, name: str) -> ParameterValue:
        return await self.commands.get_parameter(self.row, name, _moves_nothing)

    async def set_parameter(self, name: str, value: ParameterValue) -> None:
        await self.commands.set_parameter(self.row, name, value, _moves_nothing)


def _moves_nothing() -> None:
    """Parameters may also be read and set after a kill."""
