"""Fault commands in JSON: which fault, for which vehicles, for how long. Strict."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

Value: TypeAlias = float | str

LONGEST_LINE = 65536


class FaultCommandError(ValueError):
    """A command that cannot be executed; the message gives the reason."""


@dataclass(frozen=True, slots=True)
class Number:
    """A field with a number from low to high; required if it has no default."""

    low: float
    high: float
    default: float | None = None

    def read(self, name: str, value: object) -> Value:
        """The number. Raises: FaultCommandError."""
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not self.low <= value <= self.high
        ):
            raise FaultCommandError(
                f"{name} must be a number from {self.low:g} to {self.high:g}, not {value!r}"
            )
        return float(value)


@dataclass(frozen=True, slots=True)
class Choice:
    """A field with one of these words; the first is the default."""

    words: tuple[str, ...]

    @property
    def default(self) -> str:
        return self.words[0]

    def read(self, name: str, value: object) -> Value:
        """The word. Raises: FaultCommandError."""
        if not isinstance(value, str) or value not in self.words:
            raise FaultCommandError(f"{name} must be one of {', '.join(self.words)}, not {value!r}")
        return value


Field: TypeAlias = Number | Choice

SHARE = MappingProxyType({"share": Number(0.0, 1.0)})
WAY = MappingProxyType({"way": Choice(("both", "out", "in"))})
STEP_M = Number(-1e5, 1e5, 0.0)
SPEED_M_S = Number(-50.0, 50.0, 0.0)
ACCURACY = Number(0.0, 500.0, math.nan)
SHIFT: Mapping[str, Field] = MappingProxyType({"north_m": STEP_M, "east_m": STEP_M, "down_m": STEP_M})
FIXES = MappingProxyType(
    {"none": 1, "no-gps": 0, "2d": 2, "3d": 3, "dgps": 4, "rtk-float": 5, "rtk-fixed": 6}
)
"""GPS_FIX_TYPE."""
SENSORS = MappingProxyType(
    {"gyro": 0x1, "accelerometer": 0x2, "magnetometer": 0x4, "barometer": 0x8, "gps": 0x20, "ahrs": 0x200000}
)
"""Bits of MAV_SYS_STATUS_SENSOR."""
PILOTED = ("POSITION", "ALTITUDE", "MANUAL", "STABILIZED", "HOLD", "LAND", "RETURN")

LINK_FAULTS: Mapping[str, Mapping[str, Field]] = MappingProxyType(
    {
        "silence": WAY,
        "loss": SHARE | WAY,
        "delay": {"delay_s": Number(0.0, 60.0, 0.0), "jitter_s": Number(0.0, 60.0, 0.0)} | WAY,
        "reorder": SHARE | WAY,
        "late": SHARE | {"least_s": Number(0.0, 60.0, 0.1), "most_s": Number(0.0, 60.0, 10.0)} | WAY,
        "duplicate": SHARE | WAY,
        "corrupt": SHARE | WAY,
        "jam": {"rate_hz": Number(0.0, 10_000.0)},
    }
)
VEHICLE_FAULTS: Mapping[str, Mapping[str, Field]] = MappingProxyType(
    {
        "gps-jump": SHIFT,
        "gps-freeze": {},
        "report-freeze": {},
        "report-velocity": {"times": Number(-10.0, 10.0)},
        "barometer": {"up_m": STEP_M},
        "accuracy": dict.fromkeys(("eph_m", "epv_m", "hdop", "vdop"), ACCURACY),
        "wind": {"north_m_s": SPEED_M_S, "east_m_s": SPEED_M_S, "down_m_s": SPEED_M_S},
        "fix": {"type": Choice(tuple(FIXES))},
        "sensor": {"which": Choice(tuple(SENSORS))},
        "wrong-time": {"ahead_s": Number(-1e9, 1e9)},
        "stuck-mode": {"answer": Choice(("accepted", "rejected"))},
        "transponder": {"how": Choice(("lost", "not-good", "lost-operator"))},
        "pilot": {
            "mode": Choice(PILOTED),
            "by": Choice(("switch", "sticks")),
            "north_m_s": SPEED_M_S,
            "east_m_s": SPEED_M_S,
            "down_m_s": SPEED_M_S,
        },
    }
)
EVENTS: Mapping[str, Mapping[str, Field]] = MappingProxyType(
    {
        "none": {},
        "position-reset": SHIFT,
        "clock-jump": {"by_s": Number(-1e6, 1e6)},
        "reboot": {"off_s": Number(0.0, 60.0, 1.0), "motors": Choice(("stop", "go-on"))},
        "battery": {"remaining": Number(0.0, 1.0)},
        "termination": {},
        "compass": {},
    }
)
FAULTS: Mapping[str, Mapping[str, Field]] = MappingProxyType({**LINK_FAULTS, **VEHICLE_FAULTS, **EVENTS})


@dataclass(frozen=True, slots=True)
class FaultCommand:
    """One fault for some vehicles. for_s is inf where it lasts until it is ended by a command."""

    fault: str
    vehicles: tuple[int, ...] | None  # numbers from 1; None: all
    values: Mapping[str, Value]
    for_s: float = math.inf


def parse(line: str | bytes) -> FaultCommand:
    """Read one line of JSON.

    Raises: FaultCommandError for no JSON object, an unknown name, or a value out of range.
    """
    if len(line) > LONGEST_LINE:
        raise FaultCommandError(f"a line of {len(line)} bytes; at most {LONGEST_LINE} are read")
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise FaultCommandError(f"not JSON: {error}") from None
    if not isinstance(fields, dict):
        raise FaultCommandError('a command is an object, as in {"vehicle": 3, "fault": "loss", "share": 0.3}')
    fault = fields.pop("fault", None)
    if not isinstance(fault, str) or fault not in FAULTS:
        raise FaultCommandError(f"fault must be one of {', '.join(FAULTS)}, not {fault!r}")
    vehicles = _vehicles(fields)
    for_s = math.inf
    if "for_s" in fields:
        if fault in EVENTS:
            raise FaultCommandError(f"{fault} happens once: for_s does not go with it")
        for_s = float(Number(0.0, 1e6).read("for_s", fields.pop("for_s")))
    return FaultCommand(fault, vehicles, _values(fault, fields), for_s)


def _values(fault: str, fields: Mapping[str, object]) -> dict[str, Value]:
    """The values of a fault's own fields. Raises: FaultCommandError."""
    form, values = FAULTS[fault], dict[str, Value]()
    for name in fields:
        if name not in form:
            takes = ", ".join(["vehicle", "vehicles", "fault", "for_s", *form])
            raise FaultCommandError(f"{name}: {fault} has no such field; it takes {takes}")
    for name, field in form.items():
        if name in fields:
            values[name] = field.read(name, fields[name])
        elif field.default is None:
            raise FaultCommandError(f"{name} is missing")
        else:
            values[name] = field.default
    return values


def _vehicles(fields: dict[str, object]) -> tuple[int, ...] | None:
    """The vehicle numbers, from 1; removed from the fields."""
    if ("vehicle" in fields) == ("vehicles" in fields):
        raise FaultCommandError(
            'either "vehicle": 3 or "vehicles": [1, 2] or "vehicles": "all" must be there'
        )
    if "vehicle" in fields:
        desired: object = [fields.pop("vehicle")]
    else:
        desired = fields.pop("vehicles")
        if desired == "all":
            return None
    if not isinstance(desired, list) or not desired:
        raise FaultCommandError(f'vehicles must be a list of numbers, or "all", not {desired!r}')
    for number in desired:
        if isinstance(number, bool) or not isinstance(number, int) or number < 1:
            raise FaultCommandError(f"{number!r} is no vehicle's number: they are whole, from 1")
    return tuple(dict.fromkeys(desired))
