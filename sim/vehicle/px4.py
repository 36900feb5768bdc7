"""PX4 in tables: its flight modes, its habits (quirks) and the encoding of its parameters."""

import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from enum import Enum

import numpy as np

from gcs.sim.vehicle import versions
from gcs.sim.vehicle.parameters import REAL32, ParameterError, ParameterList, Table, Value

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
    TERMINATION = (10, 0, CUSTOM)

    @property
    def number(self) -> int:
        return NUMBERS[self]

    @staticmethod
    def find(main: int, sub: int) -> "Mode | None":
        """The mode that can be commanded by these numbers."""
        return next((mode for mode in COMMANDED if mode.value[:2] == (main, sub)), None)


MODES = tuple(Mode)
COMMANDED = tuple(mode for mode in Mode if mode is not Mode.TERMINATION)
NUMBERS = {mode: number for number, mode in enumerate(MODES)}
CUSTOM_MODES = np.array([mode.value[0] << 16 | mode.value[1] << 24 for mode in MODES], dtype=np.uint32)
BASE_MODES = np.array([mode.value[2] for mode in MODES], dtype=np.uint8)
"""The HEARTBEAT's fields by mode; base_mode while disarmed."""
NEEDS_PILOT = frozenset({Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION, Mode.STABILIZED})
PREVENTS_ARMING = frozenset({Mode.LAND, Mode.RETURN, Mode.TERMINATION})
NEEDS_POSITION = frozenset({Mode.TAKEOFF, Mode.HOLD, Mode.RETURN, Mode.OFFBOARD, Mode.POSITION})


class QuirkError(ValueError):
    """There is no such quirk."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quirks:
    """On is the autopilot's behaviour; off is the ideal one. On the command line `_` is written `-`."""

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
    failsafe_hold: bool = True
    """A failsafe for battery or station holds for COM_FAIL_ACT_T before its action; off: it acts at once."""
    estimator_resets: bool = True
    """The estimator is reset 13 times before the vehicle is ready and once in each flight, where its heading
    turns by up to 4 degrees; off: never."""
    console_text: bool = True
    """ArduPilot writes console text on its link at boot; off: frames only."""
    height_scale: bool = True
    """ArduPilot's height is 5 % too large; off: it is true."""
    patient_offboard: bool = True
    """13: OFFBOARD continues at 2 Hz, up to COM_OF_LOSS_T between setpoints; off: 0.25 s is too long."""

    def changed(self, changes: Iterable[tuple[str, bool]]) -> "Quirks":
        """A copy with these switches set; names as on the command line.

        Raises: QuirkError for an unknown quirk.
        """
        names = set(quirk_names())
        desired = dict(changes)
        for name in desired:
            if name not in names:
                raise QuirkError(f"{name}: no such quirk; there are {', '.join(quirk_names())}")
        return replace(self, **{name.replace("-", "_"): on for name, on in desired.items()})


def quirk_names() -> tuple[str, ...]:
    return tuple(field.name.replace("_", "-") for field in fields(Quirks))


def defaults() -> Mapping[str, Value]:
    """Those of the recorded PX4 v1.16.1, sorted by name, read-only."""
    return versions.find("px4").parameters.defaults


class Parameters(Table):
    """One vehicle's parameters, of the recorded version without another list."""

    def __init__(
        self, settings: Mapping[str, Value] | None = None, listed: ParameterList | None = None
    ) -> None:
        """See `Table`. Raises: ParameterError as in `set`."""
        super().__init__(versions.find("px4").parameters if listed is None else listed, settings)


def encoded_value(kind: int, value: Value) -> float:
    """PX4's bytewise encoding: the float field contains an INT32's four bytes."""
    if kind == REAL32:
        return float(value)
    return float(struct.unpack("<f", struct.pack("<i", int(value)))[0])


def decoded_value(kind: int, param_type: int, value: float) -> Value:
    """Undo encoded_value. Raises: ParameterError when the sender uses another type than `kind`."""
    if param_type != kind:
        raise ParameterError(f"MAV_PARAM_TYPE {kind} is needed, not {param_type}")
    if param_type == REAL32:
        return value
    return int(struct.unpack("<i", struct.pack("<f", value))[0])
