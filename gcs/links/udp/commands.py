"""Commands and parameters of one vehicle, and its answers. Tasks of the loop, no threads."""

import asyncio
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import development as dialect

from gcs.links.command_protocol import CLOSED, TIMEOUT
from gcs.links.link import ParameterValue
from gcs.mavlink.codec import Records, records, text, text_field
from gcs.mavlink.framing import COMMAND_LONG
from gcs.mavlink.kernels import Whole
from gcs.model.errors import CommandError

COMMAND_ACK: Final = 77
PARAM_REQUEST_READ: Final = 20
PARAM_VALUE: Final = 22
PARAM_SET: Final = 23

ANSWER_S: Final = 0.5
TRIES: Final = 4
LONGEST_S: Final = 10.0
"""Longest time for an answer after IN_PROGRESS."""

_AUTOPILOT_COMPONENT: Final = 1
_NAME_LENGTH: Final = 16
_IN_PROGRESS: Final = int(dialect.MAV_RESULT_IN_PROGRESS)
_FAILURES: Final = {
    int(dialect.MAV_RESULT_TEMPORARILY_REJECTED): "COMMAND_REJECTED_FOR_NOW",
    int(dialect.MAV_RESULT_DENIED): "COMMAND_DENIED",
    int(dialect.MAV_RESULT_UNSUPPORTED): "COMMAND_UNSUPPORTED",
    int(dialect.MAV_RESULT_FAILED): "COMMAND_FAILED",
    6: "COMMAND_CANCELLED",
}

_FLOAT: Final = int(dialect.MAV_PARAM_TYPE_REAL32)
_WHOLE: Final = {
    int(dialect.MAV_PARAM_TYPE_UINT8): np.uint32,
    int(dialect.MAV_PARAM_TYPE_INT8): np.int32,
    int(dialect.MAV_PARAM_TYPE_UINT16): np.uint32,
    int(dialect.MAV_PARAM_TYPE_INT16): np.int32,
    int(dialect.MAV_PARAM_TYPE_UINT32): np.uint32,
    int(dialect.MAV_PARAM_TYPE_INT32): np.int32,
}
_INT32: Final = int(dialect.MAV_PARAM_TYPE_INT32)

Gate = Callable[[], None]
"""Called before anything leaves; raises CommandError when it may not."""


class Answer(NamedTuple):
    """A command's result, or a parameter's value."""

    result: int = 0
    value: ParameterValue = 0


class Commands:
    """Repeats commands until they are answered, matching answers by vehicle and command (or parameter).

    At most one of a kind at a time for each vehicle: a second waits for the first.
    """

    def __init__(self, system_ids: Whole, tell: Callable[[int, Records, Whole], object]) -> None:
        """`tell` sends messages of one kind to rows of the link."""
        self._system_ids = system_ids
        self._tell = tell
        self._closed = False
        self._pending: dict[tuple[int, int | str], asyncio.Future[Answer]] = {}
        self._locks: dict[tuple[int, int | str], asyncio.Lock] = {}

    @property
    def awaited(self) -> bool:
        """Whether an answer is awaited."""
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
        message = records(COMMAND_LONG, 1)
        message["target_system"], message["target_component"] = self._system_ids[row], _AUTOPILOT_COMPONENT
        message["command"] = command
        for number, value in enumerate(values, 1):
            message[f"param{number}"] = value

        def again(attempt: int) -> None:
            message["confirmation"] = attempt
            self._tell(COMMAND_LONG, message, np.array([row]))

        answer = await self._ask((row, command), again, may_leave)
        if answer.result:
            raise CommandError(_FAILURES.get(answer.result, f"COMMAND_RESULT_{answer.result}"))

    async def get_parameter(self, row: int, name: str, may_leave: Gate) -> ParameterValue:
        """A parameter's value. Raises: CommandError, TIMEOUT for one that the vehicle does not have."""
        message = records(PARAM_REQUEST_READ, 1)
        message["target_system"], message["target_component"] = self._system_ids[row], _AUTOPILOT_COMPONENT
        message["param_index"] = -1  # by its name
        message["param_id"] = text_field(name, _NAME_LENGTH)
        answer = await self._ask(
            (row, name), lambda _attempt: self._tell(PARAM_REQUEST_READ, message, np.array([row])), may_leave
        )
        return answer.value

    async def set_parameter(self, row: int, name: str, value: ParameterValue, may_leave: Gate) -> None:
        """Set a parameter: integers stay integers, encoded bytewise, as PX4 requires.

        Raises: CommandError when the vehicle answers with another value, or not at all.
        """
        message = records(PARAM_SET, 1)
        message["target_system"], message["target_component"] = self._system_ids[row], _AUTOPILOT_COMPONENT
        message["param_id"] = text_field(name, _NAME_LENGTH)
        message["param_type"] = _INT32 if isinstance(value, int) else _FLOAT
        message["param_value"] = (
            np.array([value], np.int32).view(np.float32) if isinstance(value, int) else value
        )
        answer = await self._ask(
            (row, name), lambda _attempt: self._tell(PARAM_SET, message, np.array([row])), may_leave
        )
        if answer.value != (value if isinstance(value, int) else float(np.float32(value))):
            raise CommandError(f"the vehicle says that it is {answer.value:g}")

    def take_acks(self, rows: Whole, reported: Records) -> None:
        """Read COMMAND_ACKs: (k,) rows and messages, in order of arrival."""
        for row, command, result in zip(
            rows.tolist(), reported["command"].tolist(), reported["result"].tolist(), strict=True
        ):
            self._resolve((row, command), Answer(result))

    def take_values(self, rows: Whole, reported: Records) -> None:
        """Read PARAM_VALUEs."""
        for row, (name, value) in zip(rows.tolist(), parameter_values(reported), strict=True):
            self._resolve((row, name), Answer(value=value))

    def _resolve(self, key: tuple[int, int | str], answer: Answer) -> None:
        waiting = self._pending.get(key)
        if waiting is not None and not waiting.done():
            waiting.set_result(answer)

    async def _ask(
        self, key: tuple[int, int | str], send: Callable[[int], object], may_leave: Gate
    ) -> Answer:
        """Send until there is an answer. Raises: CommandError."""
        loop = asyncio.get_running_loop()
        async with self._locks.setdefault(key, asyncio.Lock()):
            may_leave()
            give_up_s = loop.time() + LONGEST_S
            attempt, patient = 0, False
            while attempt < TRIES and loop.time() < give_up_s:
                if self._closed:
                    raise CommandError(CLOSED)
                waiting: asyncio.Future[Answer] = loop.create_future()
                self._pending[key] = waiting
                if not patient:
                    send(attempt)
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


def parameter_values(reported: Records) -> list[tuple[str, ParameterValue]]:
    """Names and values of PARAM_VALUEs, integers encoded bytewise, as PX4 does."""
    values: list[tuple[str, ParameterValue]] = []
    for message in reported:
        whole = _WHOLE.get(int(message["param_type"]))
        value: ParameterValue = float(message["param_value"])
        if whole is not None:
            value = int(np.array([message["param_value"]], np.float32).view(whole)[0])
        values.append((text(message["param_id"]), value))
    return values
