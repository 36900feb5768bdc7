"""PX4 v1.16.1 in tables: its flight modes, its habits (quirks) and its parameters.

The parameters are what a PX4 v1.16.1 SITL listed (px4_params.json: integers are INT32, the others FLOAT).
"""

import json
import math
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from enum import Enum
from functools import cache, partial
from importlib import resources
from types import MappingProxyType
from typing import Protocol, TypeAlias

import numpy as np

from gcs.sim.vehicle.dynamics import Array

ARMED, MANUAL_INPUT, STABILIZE, GUIDED, AUTO, CUSTOM = 128, 64, 16, 8, 4, 1


class Mode(Enum):
    """A mode: PX4's main and sub mode, and the base_mode bits that go with them."""

    MANUAL = (1, 0, MANUAL_INPUT | CUSTOM)
    ALTITUDE = (2, 0, MANUAL_INPUT | STABILIZE | CUSTOM)
    POSITION = (3, 0, MANUAL_INPUT | STABILIZE | CUSTOM)
    TAKEOFF = (4, 2, STABILIZE | GUIDED | AUTO | CUSTOM)
    HOLD = (4, 3, STABILIZE | GUIDED | AUTO | CUSTOM)
    RETURN = (4, 5, STABILIZE | GUIDED | AUTO | CUSTOM)
    LAND = (4, 6, STABILIZE | GUIDED | AUTO | CUSTOM)
    OFFBOARD = (6, 0, STABILIZE | CUSTOM)
    STABILIZED = (7, 0, MANUAL_INPUT | STABILIZE | CUSTOM)

    @property
    def number(self) -> int:
        return NUMBERS[self]

    @staticmethod
    def find(main: int, sub: int) -> "Mode | None":
        return next((mode for mode in Mode if mode.value[:2] == (main, sub)), None)


MODES = tuple(Mode)
NUMBERS = {mode: number for number, mode in enumerate(MODES)}
CUSTOM_MODES = np.array([mode.value[0] << 16 | mode.value[1] << 24 for mode in MODES], dtype=np.uint32)
BASE_MODES = np.array([mode.value[2] for mode in MODES], dtype=np.uint8)
"""The HEARTBEAT's fields by mode; base_mode while disarmed."""
NEEDS_PILOT = frozenset({Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION, Mode.STABILIZED})
PREVENTS_ARMING = frozenset({Mode.LAND, Mode.RETURN})
# COM_OBL_RC_ACT to the mode flown after setpoints are lost; 6 and 7 stop the motors instead.
OFFBOARD_LOSS_MODE = {
    0: Mode.POSITION,
    1: Mode.ALTITUDE,
    2: Mode.MANUAL,
    3: Mode.RETURN,
    4: Mode.LAND,
    5: Mode.HOLD,
}
# NAV_DLL_ACT to the mode flown after the last ground station is lost; 5 and 6 stop the motors instead.
STATION_LOSS_MODE = {1: Mode.HOLD, 2: Mode.RETURN, 3: Mode.LAND}


class QuirkError(ValueError):
    """There is no such quirk."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quirks:
    """On is PX4's behaviour; off is the ideal one. On the command line `_` is written `-`."""

    own_origin: bool = True
    """1: each local NED origin is the vehicle's own first fix; off: all have the fleet's."""
    late_ready: bool = True
    """2: ready to arm 4 to 6 s after start; off: after 0.1 s."""
    double_ack: bool = True
    """3: DO_SET_MODE is acknowledged ACCEPTED at once, then with the result; off: with the result only."""
    starved_offboard: bool = True
    """4: OFFBOARD without setpoints is accepted disarmed, then arming is refused; in the air it is refused.
    Off: both are accepted."""
    setpoint_loss: bool = True
    """5: COM_OBL_RC_ACT acts COM_OF_LOSS_T after the last setpoint; off: the last setpoint stays in force."""
    resume: bool = True
    """6: OFFBOARD resumes by itself when setpoints return; off: only by command."""
    mode_reverts: bool = True
    """7: after landing and disarming the mode falls back, for example to OFFBOARD; off: to HOLD."""
    quiet_texts: bool = True
    """8: texts only while a ground station's heartbeats arrive; off: always."""
    late_heartbeat: bool = True
    """9: a mode change shows in the next HEARTBEAT, up to 1 s late; off: one is sent at every change."""
    whole_velocity: bool = True
    """10: a velocity with a missing axis is not followed; off: its given axes are."""
    early_takeoff: bool = True
    """11: NAV_TAKEOFF while disarmed is accepted and happens at the next arming; off: it is refused."""
    disarm_refused: bool = True
    """11: DISARM in the air is refused; off: it stops the motors."""
    slow_clock: bool = True
    """12: the boot clock loses 1 to 2 %; off: it is exact. (Jumps are faults: clock-jump, reboot.)"""
    patient_offboard: bool = True
    """13: OFFBOARD continues at 2 Hz, up to COM_OF_LOSS_T between setpoints; off: 0.25 s is too long."""

    def changed(self, changes: Iterable[tuple[str, bool]]) -> "Quirks":
        """A copy with these switches set; names as on the command line.

        Raises: QuirkError for an unknown quirk.
        """
        known = set(quirk_names())
        desired = dict(changes)
        for name in desired:
            if name not in known:
                raise QuirkError(f"{name}: no such quirk; there are {', '.join(quirk_names())}")
        return replace(self, **{name.replace("-", "_"): on for name, on in desired.items()})


def quirk_names() -> tuple[str, ...]:
    return tuple(field.name.replace("_", "-") for field in fields(Quirks))


Value: TypeAlias = int | float

INT32, REAL32 = 6, 9  # MAV_PARAM_TYPE
INT32_RANGE = range(-(2**31), 2**31)
REAL32_MAX = 3.4028234e38


class ParameterError(ValueError):
    """A parameter does not exist, or does not accept that value."""


@cache
def defaults() -> Mapping[str, Value]:
    """The recorded table, sorted by name, read-only."""
    text = resources.files("gcs.sim").joinpath("px4_params.json").read_text(encoding="ascii")
    table: dict[str, Value] = json.loads(text)
    return MappingProxyType(dict(sorted(table.items())))


class Parameters:
    """One vehicle's parameters. Only existing ones can be set, only to finite values of their type."""

    def __init__(self, settings: Mapping[str, Value] | None = None) -> None:
        """Start from the defaults, changed by settings. Raises: ParameterError as in `set`."""
        self._changed: dict[str, Value] = {}
        self.on_change: Callable[[str, Value], None] | None = None
        for name, value in (settings or {}).items():
            self.set(name, value)

    def __getitem__(self, name: str) -> Value:
        """The value; KeyError where there is no such parameter."""
        value = self._changed.get(name)
        return defaults()[name] if value is None else value

    def set(self, name: str, value: Value) -> None:
        """Change one value.

        Raises:
            ParameterError: no such parameter, or a value that is not finite, not in range, or (for an
                INT32) not whole.
        """
        if name not in defaults():
            raise ParameterError(f"{name}: PX4 v1.16 has no such parameter")
        if not math.isfinite(value) or abs(value) > REAL32_MAX:
            raise ParameterError(f"{name}: {value} is not a finite number that a parameter can hold")
        if kind(name) == INT32:
            if value != int(value) or int(value) not in INT32_RANGE:
                raise ParameterError(f"{name}: {value} is not a whole number of 32 bits")
            self._changed[name] = int(value)
        else:
            self._changed[name] = float(value)
        if self.on_change is not None:
            self.on_change(name, self._changed[name])


class Table(Protocol):
    """One vehicle's parameters, of any autopilot."""

    on_change: Callable[[str, Value], None] | None

    def __getitem__(self, name: str) -> Value: ...

    def set(self, name: str, value: Value) -> None:
        """Change one value. Raises: ParameterError."""
        ...


class Columns:
    """The parameters of a fleet as (n,) arrays, for values computed for all vehicles at once.

    A column is created on first use, and follows every change of a vehicle's own table.
    """

    def __init__(self, vehicles: Sequence[Table]) -> None:
        """Row i is vehicles[i], whose changes are followed from now on."""
        self._vehicles = vehicles
        self._columns: dict[str, Array] = {}
        self._axes: dict[tuple[str, str], Array] = {}
        for row, parameters in enumerate(vehicles):
            parameters.on_change = partial(self._change, row)

    def __getitem__(self, name: str) -> Array:
        """(n,), read-only by agreement; KeyError where there is no such parameter."""
        column = self._columns.get(name)
        if column is None:
            column = np.array([parameters[name] for parameters in self._vehicles], dtype=np.float64)
            self._columns[name] = column
        return column

    def axes(self, across: str, down: str) -> Array:
        """(n, 3), read-only by agreement: one parameter for north and east, one for down."""
        both = self._axes.get((across, down))
        if both is None:
            both = np.stack([self[across], self[across], self[down]], axis=1)
            self._axes[across, down] = both
        return both

    def _change(self, row: int, name: str, value: Value) -> None:
        self._axes = {names: both for names, both in self._axes.items() if name not in names}
        if name in self._columns:
            self._columns[name][row] = value


def kind(name: str) -> int:
    return INT32 if isinstance(defaults()[name], int) else REAL32


@cache
def index(name: str) -> int:
    return tuple(defaults()).index(name)


def name_at(place: int) -> str | None:
    names = tuple(defaults())
    return names[place] if 0 <= place < len(names) else None


def encoded_value(name: str, value: Value) -> float:
    """PX4's bytewise encoding: the float field contains an INT32's four bytes."""
    if kind(name) == REAL32:
        return float(value)
    return float(struct.unpack("<f", struct.pack("<i", int(value)))[0])


def decoded_value(name: str, param_type: int, value: float) -> Value:
    """Undo encoded_value. Raises: ParameterError when the sender uses another type."""
    if param_type != kind(name):
        raise ParameterError(f"{name} is of MAV_PARAM_TYPE {kind(name)}, not {param_type}")
    if param_type == REAL32:
        return value
    return int(struct.unpack("<i", struct.pack("<f", value))[0])
