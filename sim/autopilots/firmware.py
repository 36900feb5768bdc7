"""What a fleet needs of the autopilots in it, which are all of one kind."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.sim.protocol.base import BaseAutopilot
from gcs.sim.protocol.frames import Fields
from gcs.sim.protocol.streams import Outbox, Schedule
from gcs.sim.settings import Settings
from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.px4 import Value
from gcs.sim.vehicle.sensors import Receiver, Sensors
from gcs.sim.vehicle.state import Rows, State

Sent: TypeAlias = dict[int, list[bytes]]
"""Frames by row."""


@dataclass(frozen=True, slots=True, eq=False)
class Services:
    """What a fleet does for its firmware."""

    outbox: Outbox
    set_home: Callable[[int], None]  # of a row, to the vehicle's present place
    reboot: Callable[[int], None]


@dataclass(frozen=True, slots=True, eq=False)
class Disturbance:
    """What disturbs the vehicles in one step: (n, 3) each, NED, m/s."""

    wind_m_s: Array
    velocity_error_m_s: Array  # of the vehicles' own estimates


class Bodies(Protocol):
    """The vehicles' bodies and their control loops; row i is vehicle i. A step replaces the arrays.

    Attributes:
        position_m: (n, 3), NED.
        velocity_m_s: (n, 3), over ground.
        acceleration_m_s2: (n, 3), of thrust and tilt, without drag.
    """

    position_m: Array
    velocity_m_s: Array
    acceleration_m_s2: Array

    def rest_on_ground(self) -> Mask:
        """Stop vehicles that have reached the ground. Returns: (n,) which touch it and do not climb."""
        ...


class Firmware(Protocol):
    """The autopilots of a fleet, all of one kind: everything that depends on which autopilot it is.

    Attributes:
        forms: messages of the dialect that the vehicles speak, by id.
        any_component: whether a message for another component of the vehicle is executed as well.
        receiver: what its satellite receiver reports.
    """

    forms: Mapping[int, Any]
    any_component: bool
    receiver: Receiver

    def __init__(self, settings: Settings, position_m: Array, step_s: float, services: Services) -> None:
        """Start at position_m (n, 3) at rest. Raises: ParameterError."""
        ...

    @property
    def state(self) -> State:
        """Columns of all vehicles; row i is autopilots[i]."""
        ...

    @property
    def bodies(self) -> Bodies:
        """True positions and velocities."""
        ...

    @property
    def schedule(self) -> Schedule:
        """Due times of the streams."""
        ...

    @property
    def autopilots(self) -> Sequence[BaseAutopilot]:
        """The vehicles' protocols, by row."""
        ...

    @staticmethod
    def defaults() -> Mapping[str, Value]:
        """The parameters that there are, by name."""
        ...

    @staticmethod
    def check(name: str, value: Value) -> None:
        """Raises: ParameterError where the parameter does not exist or cannot have that value."""
        ...

    def boot(self, row: int, now_s: float, random: np.random.Generator) -> None:
        """Set the times at which a vehicle that starts at now_s becomes ready, and start its streams."""
        ...

    def start_streams(self, row: int, now_s: float, random: np.random.Generator) -> None:
        """Start what a vehicle sends without a request, after a boot at now_s."""
        ...

    def step(self, sensors: Sensors, awake: Mask, disturbance: Disturbance, step_s: float) -> None:
        """Advance autopilots and bodies of the vehicles by one step; those awake (n,) have a position."""
        ...

    def report(self, message_id: int, rows: Rows, unix_s: float, sensors: Sensors) -> Fields:
        """The fields of that message for these rows."""
        ...

    def sending(self, message_id: int, rows: Rows) -> Rows:
        """Those of the rows that have such a message to send now."""
        ...

    def store_setpoints(self, rows: Rows, messages: NDArray[np.void], senders: NDArray[np.uint8]) -> None:
        """Take SET_POSITION_TARGET_LOCAL_NED (m,), one for each row (m,), from systems `senders` (m,)."""
        ...

    def framed(self, sent: Sent) -> Sent:
        """The MAVLink 2 frames in the version that each vehicle speaks."""
        ...
