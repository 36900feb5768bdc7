"""Orders to vehicles, over any transport: one at a time, and belief only in the heartbeat.

PX4 acknowledges a change of mode twice, ACCEPTED first and the real result after; we take the first, as
MAVSDK does. So an acknowledgement alone proves nothing, and its absence (a lost datagram) nothing either.
"""

import asyncio
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import isfinite
from typing import Final, Protocol, TypeVar

from gcs.links.kill_latch import KillLatch
from gcs.links.link import Command, ParameterValue, Verb
from gcs.model.errors import CommandError
from gcs.model.state import Landed, Mode, VehicleId

T = TypeVar("T")

CONFIRM_S: Final = 3.2
"""Heartbeats come once a second; three of them, and a little for the road."""

_REASON_S: Final = 0.3  # the status text that explains a refusal comes shortly after it
_KILL_REPEAT_S: Final = 0.1

CLOSED: Final = "the link was closed"
TIMEOUT: Final = "TIMEOUT"
"""What a `CommandChannel` says when nobody answers."""

_DESIRED_MODE: Final = {
    Verb.TAKEOFF: Mode.TAKEOFF,
    Verb.HOLD: Mode.HOLD,
    Verb.OFFBOARD: Mode.OFFBOARD,
    Verb.LAND: Mode.LAND,
    Verb.RETURN: Mode.RETURN,
}


class ReportedState(Protocol):
    """What a vehicle's own frames said: all that is believed of it. `gcs.links.telemetry.Heard` is one."""

    @property
    def heartbeat_time_s(self) -> float:
        """Arrival of its newest heartbeat, -inf before the first."""
        ...

    @property
    def armed(self) -> bool:
        """As that says."""
        ...

    @property
    def mode(self) -> Mode:
        """As that says."""
        ...

    @property
    def text(self) -> str:
        """Its newest status text."""
        ...

    @property
    def text_time_s(self) -> float:
        """When that arrived."""
        ...

    @property
    def news(self) -> asyncio.Event:
        """Fires at its next heartbeat; another one afterwards."""
        ...


class CommandChannel(Protocol):
    """How a transport moves one vehicle."""

    def landed(self) -> Landed:
        """As it said last."""
        ...

    async def command(self, command: Command, may_leave: Callable[[], None]) -> None:
        """Send what the order needs, and wait for the acknowledgement, however long the transport does.

        `may_leave` is called before anything leaves, when earlier calls for this vehicle have ended, on
        whichever thread sends it; it raises CommandError when nothing may any more.

        Raises: CommandError with a name for the failure.
        """
        ...

    async def parameter(self, name: str) -> ParameterValue:
        """What the autopilot holds. Raises: CommandError with a name for the failure."""
        ...

    async def set_parameter(self, name: str, value: ParameterValue) -> None:
        """Change it, and wait for the answer. Raises: CommandError with a name for the failure."""
        ...


def obeyed(verb: Verb, reported: ReportedState, landed: Landed) -> bool:
    """Whether a vehicle's heartbeat (for TAKEOFF and LAND also its landed state) shows that it obeyed."""
    match verb:
        case Verb.ARM:
            return reported.armed
        case Verb.DISARM | Verb.KILL:
            return not reported.armed
        case Verb.TAKEOFF:
            climbed = landed in (Landed.IN_AIR, Landed.TAKEOFF)
            return reported.armed and (reported.mode is Mode.TAKEOFF or climbed)
        case Verb.LAND:
            return reported.mode is Mode.LAND or (landed is Landed.ON_GROUND and not reported.armed)
        case _:
            return reported.mode is _DESIRED_MODE[verb]


class CommandProtocol:
    """Executes orders; one at a time per vehicle, except KILL, which waits for nobody."""

    def __init__(
        self, system_ids: Mapping[VehicleId, int], latch: KillLatch, clock: Callable[[], float]
    ) -> None:
        """A lock per vehicle, so that silent ones never keep another's order waiting."""
        self._system_ids = system_ids
        self._latch = latch
        self._clock = clock
        self._locks = {vehicle_id: asyncio.Lock() for vehicle_id in system_ids}
        self._closed = False
        self._awaited = 0

    @property
    def awaited(self) -> bool:
        """Whether somebody waits for an answer."""
        return self._awaited > 0

    def close(self) -> None:
        """Send nothing more; orders under way fail. On the loop's thread."""
        self._closed = True

    async def execute(self, command: Command, channel: CommandChannel, reported: ReportedState) -> None:
        """Order, and return when the vehicle's heartbeat shows that it obeyed. Raises: CommandError."""
        ticket = self._latch.ticket(self._system_ids[command.vehicle_id])

        def may_leave() -> None:
            if not self._latch.redeem(self._system_ids[command.vehicle_id], ticket):
                raise CommandError("killed meanwhile")
            if self._closed:
                raise CommandError(CLOSED)

        with self._awaiting():
            async with self._locks[command.vehicle_id]:
                _refuse_the_impossible(command, reported)
                began_s = self._clock()
                cause: str | None = None
                try:
                    await channel.command(command, may_leave)
                except CommandError as error:
                    cause = str(error)
                wait_s = CONFIRM_S if cause is None else _REASON_S
                if not await self._confirmed(command.verb, channel, reported, began_s, wait_s):
                    raise CommandError(self._failure(command, cause, reported, began_s))

    async def read_parameters(
        self, vehicle_id: VehicleId, names: Sequence[str], channel: CommandChannel
    ) -> Mapping[str, ParameterValue]:
        """One after the other: orders pass in between. Raises: CommandError naming the parameter."""
        with self._awaiting():
            return {name: await _about(vehicle_id, name, channel.parameter(name)) for name in names}

    async def set_parameter(
        self, vehicle_id: VehicleId, name: str, value: ParameterValue, channel: CommandChannel
    ) -> None:
        """Change one. Raises: CommandError naming it."""
        with self._awaiting():
            await _about(vehicle_id, name, channel.set_parameter(name, value))

    async def kill(self, command: Command, reported: ReportedState, send_kill: Callable[[], None]) -> None:
        """Send the kill command now and again until the heartbeat says disarmed. Raises: CommandError.

        Not as one command among others: this one goes out at once, and shuts the latch behind it.
        """
        began_s = self._clock()
        self._latch.shut(self._system_ids[command.vehicle_id])
        with self._awaiting():
            while self._clock() - began_s < CONFIRM_S:
                send_kill()
                await _news(reported, _KILL_REPEAT_S)
                if reported.heartbeat_time_s > began_s and not reported.armed:
                    return
            raise CommandError(self._failure(command, None, reported, began_s))

    @contextmanager
    def _awaiting(self) -> Iterator[None]:
        self._awaited += 1
        try:
            yield
        finally:
            self._awaited -= 1

    async def _confirmed(
        self, verb: Verb, channel: CommandChannel, reported: ReportedState, began_s: float, wait_s: float
    ) -> bool:
        """Whether a heartbeat younger than the order shows it obeyed, within `wait_s`."""
        until_s = self._clock() + wait_s
        while not self._closed:  # a closed link's vehicles must not be asked any more
            if reported.heartbeat_time_s > began_s and obeyed(verb, reported, channel.landed()):
                return True
            left_s = until_s - self._clock()
            if left_s <= 0:
                return False
            await _news(reported, left_s)
        return False

    def _failure(self, command: Command, cause: str | None, reported: ReportedState, began_s: float) -> str:
        """Why an order failed, in words, with what the vehicle itself said since."""
        silent_s = self._clock() - reported.heartbeat_time_s
        state = f"it reports {reported.mode}, {'armed' if reported.armed else 'disarmed'}"
        if silent_s > CONFIRM_S:
            state = f"silent for {silent_s:.1f} s" if isfinite(silent_s) else "never heard"
        words = f'; it says "{reported.text}"' if reported.text_time_s >= began_s else ""
        failure = "sent, but not seen to happen" if cause is None else f"failed ({cause})"
        return f"{command.vehicle_id}: {command.verb} {failure}: {state}{words}"


async def _about(vehicle_id: VehicleId, name: str, answer: Awaitable[T]) -> T:
    """The answer about a parameter.

    A name that does not exist is simply not answered. Raises: CommandError.
    """
    try:
        return await answer
    except CommandError as error:
        silent = "no answer; there is no such parameter, or the vehicle is not heard"
        why = silent if str(error) == TIMEOUT else str(error)
        raise CommandError(f"{vehicle_id}: parameter {name}: {why}") from error


async def _news(reported: ReportedState, wait_s: float) -> None:
    """Until the next heartbeat, or `wait_s`."""
    try:
        async with asyncio.timeout(wait_s):
            await reported.news.wait()
    except TimeoutError:
        return


def _refuse_the_impossible(command: Command, reported: ReportedState) -> None:
    if command.verb is Verb.TAKEOFF:
        if not (isfinite(command.height_m) and command.height_m > 0):
            raise CommandError(
                f"{command.vehicle_id}: takeoff to {command.height_m} m; a height above 0 is needed"
            )
        if not reported.armed:  # PX4 would accept, and climb whenever it is armed next
            raise CommandError(f"{command.vehicle_id}: takeoff while disarmed; arm it first")
