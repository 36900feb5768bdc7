"""What the protocols of all autopilots have in common, for one vehicle."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from enum import Enum
from typing import ClassVar, Protocol, TypeAlias

from gcs.sim.protocol.equipment import Equipment
from gcs.sim.protocol.fences import Fences
from gcs.sim.protocol.frames import AUTOPILOT_COMPONENT, Message
from gcs.sim.protocol.remote_id import MESSAGES, Transponder, TransponderFault
from gcs.sim.protocol.streams import Item, Outbox
from gcs.sim.vehicle.parameters import Table
from gcs.sim.vehicle.state import State, Stuck

Params: TypeAlias = tuple[float, float, float, float, float, float, float]
"""The parameters of a COMMAND_LONG or COMMAND_INT."""

MAX_MESSAGE_ID = 2**24


class BaseCommander(Protocol):
    """What ground truth and faults need of the modes of one vehicle."""

    stuck: Stuck

    @property
    def mode(self) -> Enum: ...
    @property
    def armed(self) -> bool: ...
    @property
    def landed(self) -> bool: ...

    def take_over(self, mode: str, *, by_sticks: bool) -> bool:
        """Let a pilot fly it, in that mode by PX4's name; False where its settings prevent it."""
        ...

    def release(self) -> None:
        """Let it hold its place without the pilot."""
        ...

    def terminate(self) -> bool:
        """Stop the motors in flight, as its flight termination does; False where it is not armed."""
        ...

    def doubt_compass(self) -> bool:
        """Complain of the compass in flight; False where this autopilot has no such text."""
        ...


class BaseAutopilot(ABC):
    """One row of a fleet's state as a MAVLink component."""

    handlers: ClassVar[Mapping[str, Callable[..., None]]]
    """By message type: called with the autopilot and the message."""

    parameters: Table
    fences: Fences

    def __init__(self, state: State, row: int, outbox: Outbox) -> None:
        self.row = row
        self._state = state
        self._outbox = outbox
        self.equipment = Equipment()
        self.transponder: Transponder | None = None

    @property
    @abstractmethod
    def commander(self) -> BaseCommander:
        """Modes and arming."""

    @abstractmethod
    def parameter(self, name: str) -> Message:
        """PARAM_VALUE of an existing parameter, as listed."""

    @property
    def system_id(self) -> int:
        """1 to 250, unique in its namespace."""
        return int(self._state.system_id[self.row])

    def receive(self, message: Message) -> None:
        """Execute or answer a message for this vehicle; unknown ones change nothing."""
        kind = message.get_type()
        handler = self.handlers.get(kind)
        if handler is not None and not self.is_sender(message):
            handler(self, message)
        elif kind in MESSAGES and self.transponder is not None:
            self.transponder.receive(message, self._state.now_s)

    def fit_transponder(self) -> None:
        """Have a transponder for Remote ID behind it."""
        self.transponder = Transponder()

    def break_transponder(self, how: str) -> bool:
        """Give the transponder a fault. Returns: whether there is one."""
        if self.transponder is not None:
            self.transponder.fault = TransponderFault(how)
        return self.transponder is not None

    def run_transponder(self) -> None:
        """Have the transponder, if there is one, send what is due."""
        if self.transponder is None:
            return
        for message in self.transponder.due(self._state.now_s):
            self.reply(message)
        self._state.transponder_ok[self.row] = self.transponder.is_ready(self._state.now_s)

    def is_sender(self, message: Message) -> bool:
        """Whether it claims to come from this autopilot itself: ignored, as by PX4 and ArduPilot.

        Another component with its system id is accepted: vehicle 245 accepts a ground station 245/190.
        """
        sender = (message.get_srcSystem(), message.get_srcComponent())
        return bool(sender == (self.system_id, AUTOPILOT_COMPONENT))

    def reply(self, item: Item, after_s: float = 0.0) -> None:
        self._outbox.post(self.row, item, self._state.now_s + after_s)

    def forget(self) -> None:
        """Drop what has not been sent yet."""
        self._outbox.forget(self.row)
