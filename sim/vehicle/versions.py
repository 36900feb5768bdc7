"""Versions of autopilots that fake vehicles can have: parameters, and the release that is imitated.

`versions.json` has the differences from the two recorded lists, which all versions share in the rest.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, partial
from importlib import resources
from types import MappingProxyType
from typing import Any

from gcs.sim.vehicle.parameters import INT32, REAL32, ParameterList, Renamed, Value

RECORDED = ""
"""The version that was recorded: PX4 v1.16.1, and a development build of ArduCopter 4.1."""

TITLES = MappingProxyType({"px4": "PX4 v", "ardupilot": "ArduCopter "})
RELEASE_TYPES = MappingProxyType({"dev": 0, "alpha": 64, "beta": 128, "rc": 192, "": 255})
"""FIRMWARE_VERSION_TYPE; 255 is an official release."""


class VersionError(ValueError):
    """The fake fleet does not know that version; the message lists those it knows."""


@dataclass(frozen=True, eq=False)
class Version:
    """One version of an autopilot.

    Attributes:
        title: with the autopilot's name.
        software: its number, as text.
        release: major and minor number of the release whose behaviour and texts it has.
        parameters: as in the simulator, or as delivered in the firmware.
    """

    title: str
    software: str
    release: tuple[int, int]
    parameters: ParameterList

    @property
    def flight_sw_version(self) -> int:
        """As in AUTOPILOT_VERSION: major, minor, patch and release type, one byte each."""
        number, _, kind = self.software.partition("-")
        major, minor, patch = map(int, number.split("."))
        return major << 24 | minor << 16 | patch << 8 | RELEASE_TYPES[kind]


def names(autopilot: str) -> tuple[str, ...]:
    """The versions that can be chosen, oldest first."""
    return tuple(name for name in _differences()[autopilot] if name != RECORDED)


def part_for(autopilot: str, text: str) -> str:
    """The version for `autopilot` of a text that may have one for each kind, as in "1.16,4.5".

    Raises: VersionError where a part is no version of any autopilot, or two are of this one.
    """
    parts = [part.strip() for part in text.split(",") if part.strip()]
    for part in parts:
        if not any(part in names(kind) for kind in TITLES):
            offered = "; ".join(f"{title}{', '.join(names(kind))}" for kind, title in TITLES.items())
            raise VersionError(f"autopilot version {part!r} is not known; there are {offered}")
    chosen = [part for part in parts if part in names(autopilot)]
    if len(chosen) > 1:
        raise VersionError(f"autopilot versions {text!r}: one of {TITLES[autopilot].strip(' v')} is possible")
    return chosen[0] if chosen else RECORDED


def find(autopilot: str, name: str = RECORDED, *, as_delivered: bool = False) -> Version:
    """The version by its name, as in "1.16"; without one that was recorded. Raises: VersionError."""
    if name and name not in names(autopilot):
        offered = ", ".join(names(autopilot))
        raise VersionError(f"{TITLES[autopilot]}{name} is not known; there are {offered}")
    return _version(autopilot, name, as_delivered)


@cache
def _version(autopilot: str, name: str, as_delivered: bool) -> Version:
    chain = _chain(autopilot, name)
    software: str = chain[-1]["software"]
    listed = dict(_recorded(autopilot))
    renamed: dict[str, Renamed] = {}
    without: dict[str, Value] = {}
    delivered: dict[str, Value] = {}
    for step in chain:
        for changed, entry in step.get("parameters", {}).items():
            if entry is None:
                listed.pop(changed, None)
            else:
                listed[changed] = _typed(entry)
        for old, (new, unit) in step.get("renamed", {}).items():
            listed.pop(old, None)
            renamed[old] = _renamed(new, unit)
        without |= step.get("without", {})
        delivered |= step.get("as_delivered", {})
    if as_delivered:
        listed |= {own: (listed[own][0], value) for own, value in delivered.items()}
    if autopilot == "px4":
        listed = dict(sorted(listed.items()))
    title = f"{TITLES[autopilot]}{software}"
    major, minor = chain[-1].get("behaves_as", software).split(".")[:2]
    parameters = ParameterList(title, MappingProxyType(listed), renamed, without)
    return Version(title, software, (int(major), int(minor)), parameters)


def _chain(autopilot: str, name: str) -> list[Mapping[str, Any]]:
    """The recorded version, and the differences on the way from it, in their order."""
    step = _differences()[autopilot][name]
    return [*(_chain(autopilot, step["from"]) if "from" in step else ()), step]


@cache
def _differences() -> Mapping[str, Mapping[str, Mapping[str, Any]]]:
    table = _read("versions.json")
    return {autopilot: table[autopilot] for autopilot in TITLES}


@cache
def _recorded(autopilot: str) -> Mapping[str, tuple[int, Value]]:
    """Type and value by name."""
    path = "px4_params.json" if autopilot == "px4" else "autopilots/ardupilot/parameters.json"
    table = _read(path)
    return {name: _typed(entry) for name, entry in table.items()}


def _read(path: str) -> dict[str, Any]:
    table: dict[str, Any] = json.loads(resources.files("gcs.sim").joinpath(path).read_text("ascii"))
    return table


def _typed(entry: Any) -> tuple[int, Value]:
    """MAV_PARAM_TYPE and value; of PX4 only the value is given: integers are INT32, the others REAL32."""
    if isinstance(entry, list):
        return int(entry[0]), entry[1]
    return INT32 if isinstance(entry, int) else REAL32, entry


def _renamed(name: str, unit: float | str) -> Renamed:
    """`unit`: the new value of a recorded 1, or how the meaning changed."""
    if not isinstance(unit, str):
        return Renamed(name, partial(_times, unit), partial(_over, unit))
    return Renamed(name, *MEANINGS[unit])


def _times(unit: float, value: Value) -> Value:
    return value * unit


def _over(unit: float, value: Value) -> Value:
    return value / unit


MEANINGS = MappingProxyType(
    {
        # ARMING_CHECK, 1 for all checks: ARMING_SKIPCHK has what is skipped, -1 for all
        "skips": (lambda value: 0 if value else -1, lambda value: 0 if value == -1 else 1),
        # SYSID_ENFORCE: bit 0 of MAV_OPTIONS
        "bit 0": (lambda value: int(value != 0), lambda value: int(value) & 1),
        # COM_RC_OVERRIDE, bits for auto modes and OFFBOARD: MAN_OVERRIDE_SPD is for both
        "negative is off": (lambda value: 1.0 if value else -1.0, lambda value: 3 if value >= 0.0 else 0),
    }
)
"""To the new value, and back."""
