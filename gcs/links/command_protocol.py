"""Execution of commands over any transport: one at a time per vehicle, confirmed by heartbeats only.

PX4 acknowledges a change of mode twice, ACCEPTED first and the real result after; we take the first, as
MAVSDK does. ArduCopter acknowledges a take-off that its next setpoint cancels. So neither an acknowledgement
alone nor its absence (a lost datagram) proves anything.
"""

import asyncio
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import isfinite
from typing import Final, Protocol

from gcs.links.link import Command, ParameterValue, Verb
from gcs.links.telemetry import VehicleReport
from gcs.model.errors import CommandError
from gcs.model.state import Landed, Mode, VehicleId

CONFIRM_S: Final = 3.2
"""Heartbeats come once a second: time for three of them, and a margin."""

_REASON_S: Final = 0.3  # the status text that explains a refusal comes shortly after it
_KILL_REPEAT_S: Final = 0.1
_LEAST_S: Final = 0.001  # shorter waits are below the resolution of some clocks

CLOSED: Final = "the link was closed"
TIMEOUT: Final = "TIMEOUT"
"""Failure of a `CommandChannel` that receives no answer."""


class KillLatch:
    """After a kill no command given before it may reach the vehicle: one latch per system.

    MAVSDK repeats an unanswered command for 2 s. An arm command repeated after the kill would start the
    motors again, so while the latch is shut the link drops commands and setpoints for that system.
    Any thread may call anything: each method reads or writes single values of a dictionary whose keys never
    change, and a command that lost the race leaves the latch shut.
    """

    def __init__(self, system_ids: Iterable[int]) -> None:
        self._kills = dict.fromkeys(system_ids, 0)
        self._redeemed = dict(self._kills)

    def shut(self, system_id: int) -> None:
        """Record a kill command. One thread at a time."""
        self._kills[system_id] += 1

    def ticket(self, system_id: int) -> int:
        """To be taken when a command is given, and redeemed when it is executed."""
        return self._kills[system_id]

    def redeem(self, system_id: int, ticket: int) -> bool:
        """Open the latch for a command; False, and still shut, when a kill came after the command."""
        self._redeemed[system_id] = ticket
        return ticket == self._kills[system_id]

    def is_shut(self, system_id: int) -> bool:
        """Whether commands and setpoints for this system are to be dropped."""
        return self._redeemed.get(system_id) != self._kills.get(system_id)


class CommandChannel(Protocol):
    """A transport's commands and parameters for one vehicle."""

    async def command(self, command: Command, may_leave: Callable[[], None]) -> None:
        """Send what the command needs, and wait for the acknowledgement, however long the transport does.

        `may_leave` is called right before anything is sent, when earlier calls for this vehicle have ended,
        on the thread that sends; it raises CommandError when nothing may be sent any more.

        Raises: CommandError with a name for the failure.
        """

    async def parameter(self, name: str) -> ParameterValue:
        """The autopilot's value. Raises: CommandError with a name for the failure."""

    async def set_parameter(self, name: str, value: ParameterValue) -> None:
        """Set the value, and wait for the answer. Raises: CommandError with a name for the failure."""


def is_confirmed(verb: Verb, reported: VehicleReport) -> bool:
    """Whether a vehicle's heartbeat (for TAKEOFF and LAND also its landed state) confirms the command."""
    match verb:
        case Verb.ARM:
            return reported.armed
        case Verb.DISARM | Verb.KILL:
            return not reported.armed
        case Verb.TAKEOFF:
            climbed = reported.landed in (Landed.IN_AIR, Landed.TAKEOFF)
            return reported.armed and (reported.mode is Mode.TAKEOFF or climbed)
        case Verb.LAND:
            return reported.mode is Mode.LAND or (reported.landed is Landed.ON_GROUND and not reported.armed)
        case _:
            return reported.mode in reported.autopilot.modes[verb]


@dataclass(eq=False)
class CommandProtocol:
    """Executes commands, one at a time per vehicle; KILL does not wait for others."""

    system_ids: Mapping[VehicleId, int]
    latch: KillLatch
    clock: Callable[[], float]

    def __post_init__(self) -> None:
        self._locks = {vehicle_id: asyncio.Lock() for vehicle_id in self.system_ids}
        self._closed = False
        self._awaited = 0

    @property
    def awaited(self) -> bool:
        return self._awaited > 0

    def close(self) -> None:
        """Send nothing more; commands under way fail. On the loop's thread."""
        self._closed = True

    async def execute(self, command: Command, channel: CommandChannel, reported: VehicleReport) -> None:
        """Send, and return when the vehicle's heartbeat confirms the command. Raises: CommandError."""
        ticket = self.latch.ticket(self.system_ids[command.vehicle_id])

        def may_leave() -> None:
            if not self.latch.redeem(self.system_ids[command.vehicle_id], ticket):
                raise CommandError("killed meanwhile")
            if self._closed:
                raise CommandError(CLOSED)

        with self._awaiting():
            async with self._locks[command.vehicle_id]:
                _refuse_the_impossible(command, reported)
                began_s = self.clock()
                cause: str | None = None
                try:
                    await channel.command(command, may_leave)
                except CommandError as error:
                    cause = str(error)
                wait_s = CONFIRM_S if cause is None else _REASON_S
                if not await self._confirmed(command.verb, reported, began_s, wait_s):
                    raise CommandError(self._failure(command, cause, reported, began_s))

    async def read_parameters(
        self,
        vehicle_id: VehicleId,
        names: Sequence[str],
        channel: CommandChannel,
        may_lack: Collection[str] = (),
    ) -> Mapping[str, ParameterValue]:
        """One after the other: commands pass in between. Raises: CommandError naming the parameter.

        Of those that it `may_lack`, the result leaves out what is not answered.
        """
        values: dict[str, ParameterValue] = {}
        with self._awaiting():
            for name in names:
                try:
                    values[name] = await channel.parameter(name)
                except CommandError as error:
                    if str(error) != TIMEOUT or name not in may_lack:
                        raise _about(vehicle_id, name, error) from error
        return values

    async def set_parameter(
        self, vehicle_id: VehicleId, name: str, value: ParameterValue, channel: CommandChannel
    ) -> None:
        """Set one parameter. Raises: CommandError naming it."""
        with self._awaiting():
            try:
                await channel.set_parameter(name, value)
            except CommandError as error:
                raise _about(vehicle_id, name, error) from error

    async def kill(self, command: Command, reported: VehicleReport, send_kill: Callable[[], None]) -> None:
        """Send the kill command repeatedly until the heartbeat reports disarmed. Raises: CommandError.

        It does not queue behind other commands: it leaves at once, and shuts the latch.
        """
        began_s = self.clock()
        self.latch.shut(self.system_ids[command.vehicle_id])
        with self._awaiting():
            while self.clock() - began_s < CONFIRM_S:
                send_kill()
                await _await_heartbeat(reported, _KILL_REPEAT_S)
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

    async def _confirmed(self, verb: Verb, reported: VehicleReport, began_s: float, wait_s: float) -> bool:
        """Whether a heartbeat younger than the command confirms it within `wait_s`."""
        until_s = self.clock() + wait_s
        while not self._closed:  # a closed link's vehicles must not be queried any more
            if reported.heartbeat_time_s > began_s and is_confirmed(verb, reported):
                return True
            left_s = until_s - self.clock()
            if left_s < _LEAST_S:
                return False
            await _await_heartbeat(reported, left_s)
        return False

    def _failure(self, command: Command, cause: str | None, reported: VehicleReport, began_s: float) -> str:
        """Why a command failed, in words, with what the vehicle itself has reported since."""
        silent_s = self.clock() - reported.heartbeat_time_s
        state = f"it reports {reported.mode}, {'armed' if reported.armed else 'disarmed'}"
        if silent_s > CONFIRM_S:
            state = f"silent for {silent_s:.1f} s" if isfinite(silent_s) else "never received"
        text, text_time_s = reported.text
        words = f'; it reports "{text}"' if text_time_s >= began_s else ""
        failure = "sent, but not seen to happen" if cause is None else f"failed ({cause})"
        return f"{command.vehicle_id}: {command.verb} {failure}: {state}{words}"


def _about(vehicle_id: VehicleId, name: str, error: CommandError) -> CommandError:
    """The failure of a request about a parameter. No autopilot answers for a name that does not exist."""
    silent = "no answer; there is no such parameter, or the vehicle is not received"
    why = silent if str(error) == TIMEOUT else str(error)
    return CommandError(f"{vehicle_id}: parameter {name}: {why}")


async def _await_heartbeat(reported: VehicleReport, wait_s: float) -> None:
    try:
        async with asyncio.timeout(wait_s):
            await reported.next_heartbeat().wait()
    except TimeoutError:
        return


def _refuse_the_impossible(command: Command, reported: VehicleReport) -> None:
    if command.verb is Verb.TAKEOFF:
        if not (isfinite(command.height_m) and command.height_m > 0):
            raise CommandError(
                f"{command.vehicle_id}: takeoff to {command.height_m} m; a height above 0 is needed"
            )
        if not reported.armed:  # an autopilot may accept, and climb when it is armed next
            raise CommandError(f"{command.vehicle_id}: takeoff while disarmed; arm it first")
