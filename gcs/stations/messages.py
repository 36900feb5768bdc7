"""What stations send each other once a tick, as bytes: little-endian, versioned, without absolute times.

`StateBatch`: a header, one echo for each station received, one row of `ROW` for each vehicle of the station.
`FormationMessage` and `SlotsMessage`: what the leading station computes for the whole formation.
"""

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Final, NamedTuple, TypeAlias
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from gcs.formation.orbit import Center
from gcs.model.errors import LinkError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array, Mask, Mode, VehicleId

Codes: TypeAlias = NDArray[np.uint8]

VERSION: Final = 1

STATES, FORMATION, SLOTS, HOMES = 1, 2, 3, 4
"""Kinds of messages."""

PHASES: Final = tuple(Phase)
SHOW_PHASES: Final = tuple(ShowPhase)
MODES: Final = tuple(Mode)
"""Numbers on the wire are places in these."""

PHASE_CODE: Final = {phase: number for number, phase in enumerate(PHASES)}
MODE_CODE: Final = {mode: number for number, mode in enumerate(MODES)}

ALL_UP = 1
"""Flag of a station."""

EPOCH_MAX: Final = 255

UNKNOWN: Final = 0xFFFF
UNKNOWN_PERCENT: Final = 0xFF
SHARES: Final = np.where(np.arange(256) == UNKNOWN_PERCENT, np.nan, np.arange(256) / 100.0)
"""By the percent of a row."""

ROW: Final = np.dtype(
    [
        ("position_m", "<f4", 3),  # NaN: never received
        # velocity; the desired one, flown to by the newest setpoint; that setpoint, without the trim
        ("motion_cm_s", "<i2", 9),
        ("epoch", "u1"),  # of its ownership: a station that takes vehicles over counts on
        ("phase", "u1"),
        ("flags", "u1"),  # from bit 0: airborne, formed, slot stays, armed, ready, owned, commanded
        ("mode", "u1"),
        ("uncertainty_cm", "<u2"),
        ("age_ms", "<u2"),  # of the position when the batch was made
        ("yaw", "<i2"),  # 1 / 10,000 rad
        ("battery_percent", "u1"),
        ("quality_percent", "u1"),  # of its link
    ]
)

_STATION: Final = struct.Struct("<BBHIIIHBBff")
_ECHO: Final = struct.Struct("<HIf")
_FORMATION: Final = struct.Struct("<BBIIHIBBff9d")
_SLOTS: Final = struct.Struct("<BBIIHH")
SLOT_STEPS: Final = 32767.0
COUNT_MAX: Final = 1400
"""Vehicles of one station: their batch stays below 60,000 bytes."""

SIDES_MAX: Final = 20_000
"""Bytes of the sides on which obstacles are passed."""


def site_number(fleets: Mapping[str, tuple[VehicleId, ...]]) -> int:
    """A number of the site's stations and vehicles: stations with other lists ignore each other."""
    return crc32(json.dumps(list(fleets.items())).encode())


class Echo(NamedTuple):
    """The newest batch that a station received from another: by it that one measures the delay."""

    station: int  # place among the site's stations
    sequence: int
    held_s: float  # since its arrival


@dataclass(frozen=True, slots=True, eq=False)
class StateBatch:
    """One station and its n vehicles at one tick, show frame. Owns its arrays."""

    sequence: int
    site: int  # see `site_number`
    term: int  # of the lead that it obeys
    lead: int  # place among the site's stations
    show: ShowPhase
    all_up: bool  # no vehicle of it climbs, or waits for its turn to take off
    pace: float
    return_s: float  # time in the plan of the collective return, NaN: none is flown
    echoes: tuple[Echo, ...]
    position_m: Array  # (n, 3) brought forward as in FleetState; of silent vehicles the last one
    velocity_m_s: Array  # (n, 3)
    desired_m_s: Array  # (n, 3) NaN: not commanded
    setpoint_m_s: Array  # (n, 3) for them, without the trim; NaN: not commanded
    uncertainty_m: Array  # (n,)
    age_s: Array  # (n,) of the measurement, inf: never received
    phases: Codes  # (n,) places in PHASES
    modes: Codes  # (n,) places in MODES
    airborne: Mask
    formed: Mask
    slot_stays: Mask
    armed: Mask
    ready: Mask
    owned: Mask  # (n,) flown by this station; False: another station's, whose telemetry it also receives
    epochs: Codes  # (n,) of their ownership
    yaw_rad: Array
    battery_remaining: Array  # NaN: unknown
    link_quality: Array  # 0 to 1, NaN: unknown

    def encode(self) -> bytes:
        """The bytes: 29, 10 for each echo, 42 for each vehicle."""
        n = len(self.position_m)
        rows = np.zeros(n, ROW)
        rows["position_m"] = self.position_m
        rows["motion_cm_s"] = _cm_s(self.velocity_m_s, self.desired_m_s, self.setpoint_m_s)
        rows["phase"], rows["mode"], rows["epoch"] = self.phases, self.modes, self.epochs
        commanded = np.isfinite(self.desired_m_s[:, 0])
        masks = (self.airborne, self.formed, self.slot_stays, self.armed, self.ready, self.owned, commanded)
        rows["flags"] = np.packbits(np.stack(masks), axis=0, bitorder="little")[0]
        rows["uncertainty_cm"] = _bounded(100.0 * self.uncertainty_m)
        rows["age_ms"] = _bounded(1000.0 * self.age_s)
        rows["yaw"] = np.round(1e4 * np.nan_to_num(self.yaw_rad))
        rows["battery_percent"] = _percent(self.battery_remaining)
        rows["quality_percent"] = _percent(self.link_quality)
        show = SHOW_PHASES.index(self.show)
        flags_of_all = ALL_UP * self.all_up
        head = (VERSION, STATES, n, self.sequence, self.site, self.term, self.lead, show, flags_of_all)
        echoes = [_ECHO.pack(one.station, one.sequence, one.held_s) for one in self.echoes]
        return b"".join(
            [_STATION.pack(*head, self.pace, self.return_s), bytes([len(echoes)]), *echoes, rows.tobytes()]
        )

    @staticmethod
    def decode(payload: bytes) -> "StateBatch":
        """Raises: LinkError for bytes that are no batch of this version."""
        if len(payload) < _STATION.size + 1:
            raise LinkError(f"a batch of {len(payload)} bytes is too short")
        version, kind, n, sequence, site, term, lead, show, flags, pace, return_s = _STATION.unpack_from(
            payload
        )
        _check(version, kind, STATES)
        begin = _STATION.size + 1 + payload[_STATION.size] * _ECHO.size
        if len(payload) != begin + n * ROW.itemsize or show >= len(SHOW_PHASES) or not isfinite(pace):
            raise LinkError(f"a batch of {len(payload)} bytes for {n} vehicles")
        echoes = tuple(map(Echo._make, _ECHO.iter_unpack(payload[_STATION.size + 1 : begin])))
        rows = np.frombuffer(payload, ROW, offset=begin)
        if n and (rows["phase"].max() >= len(PHASES) or rows["mode"].max() >= len(MODES)):
            raise LinkError("a batch with a phase or mode that does not exist")
        bits = np.unpackbits(rows["flags"][None], axis=0, bitorder="little").view(np.bool_)
        airborne, formed, slot_stays, armed, ready, owned, commanded, _ = bits
        known = rows["age_ms"] != UNKNOWN
        motion_m_s = rows["motion_cm_s"] / 100.0
        return StateBatch(
            sequence,
            site,
            term,
            lead,
            SHOW_PHASES[show],
            bool(flags & ALL_UP),
            min(max(pace, 0.0), 1.0),
            return_s,
            echoes,
            _only(known, rows["position_m"].astype(np.float64)),
            motion_m_s[:, :3],
            _only(commanded, motion_m_s[:, 3:6]),
            _only(commanded, motion_m_s[:, 6:]),
            rows["uncertainty_cm"] / 100.0,
            np.where(known, rows["age_ms"] / 1000.0, np.inf),
            rows["phase"].copy(),
            rows["mode"].copy(),
            airborne,
            formed,
            slot_stays,
            armed,
            ready,
            owned,
            rows["epoch"].copy(),
            rows["yaw"] / 1e4,
            _share(rows["battery_percent"]),
            _share(rows["quality_percent"]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class FormationMessage:
    """Centre, radius and spin of the whole formation, and which plan they follow."""

    site: int
    term: int
    lead: int  # place among the site's stations
    plan: int  # its version
    show: ShowPhase
    center: Center | None
    radius_m: float
    spin_rad_s: float
    sides: dict[str, float]

    def encode(self) -> bytes:
        center = self.center or Center.at_rest(np.zeros(3))
        numbers = np.concatenate([center.position_m, center.velocity_m_s, center.acceleration_m_s2]).tolist()
        show, exists = SHOW_PHASES.index(self.show), self.center is not None
        head = (VERSION, FORMATION, self.site, self.term, self.lead, self.plan, show, exists)
        return (
            _FORMATION.pack(*head, self.radius_m, self.spin_rad_s, *numbers) + json.dumps(self.sides).encode()
        )

    @staticmethod
    def decode(payload: bytes) -> "FormationMessage":
        """Raises: LinkError for bytes that are no such message of this version."""
        if not _FORMATION.size <= len(payload) <= _FORMATION.size + SIDES_MAX:
            raise LinkError(f"a formation of {len(payload)} bytes")
        version, kind, site, term, lead, plan, show, exists, *numbers = _FORMATION.unpack_from(payload)
        _check(version, kind, FORMATION)
        if show >= len(SHOW_PHASES) or not all(map(isfinite, numbers)):
            raise LinkError("a formation with a number that is not possible")
        try:
            sides = from_json(payload[_FORMATION.size :])
        except ValueError:
            raise LinkError("a formation with sides that are no JSON") from None
        if not isinstance(sides, dict) or not all(isinstance(side, float) for side in sides.values()):
            raise LinkError("a formation with sides that are no numbers")
        radius_m, spin_rad_s, *motion = numbers
        center = Center(*np.array(motion).reshape(3, 3)) if exists else None
        return FormationMessage(
            site, term, lead, plan, SHOW_PHASES[show], center, radius_m, spin_rad_s, sides
        )


@dataclass(frozen=True, slots=True, eq=False)
class SlotsMessage:
    """Slots of one station's vehicles. Owns its array."""

    site: int
    term: int
    lead: int  # place among the site's stations
    place: Array  # (n, 3) unit vectors from the centre, NaN: none

    def encode(self) -> bytes:
        steps = SLOT_STEPS * self.place
        steps[np.isnan(steps)] = 0.0
        steps = np.rint(steps).astype("<i2")
        head = (VERSION, SLOTS, self.site, self.term, self.lead, len(steps))
        return _SLOTS.pack(*head) + steps.tobytes()

    @staticmethod
    def decode(payload: bytes) -> "SlotsMessage":
        """Raises: LinkError for bytes that are no such message of this version."""
        if len(payload) < _SLOTS.size:
            raise LinkError(f"slots of {len(payload)} bytes are too short")
        version, kind, site, term, lead, count = _SLOTS.unpack_from(payload)
        _check(version, kind, SLOTS)
        if len(payload) != _SLOTS.size + 6 * count:
            raise LinkError(f"slots of {len(payload)} bytes for {count} vehicles")
        place = np.frombuffer(payload, "<i2", offset=_SLOTS.size).reshape(count, 3).astype(np.float64)
        length = np.linalg.norm(place, axis=1, keepdims=True)
        with np.errstate(invalid="ignore"):
            return SlotsMessage(site, term, lead, place / np.where(length > SLOT_STEPS / 2, length, np.nan))


def encode_homes(home_m: Array) -> bytes:
    """Where a station's n vehicles took off: (n, 3) show frame, NaN where not known."""
    return bytes([VERSION, HOMES]) + home_m.astype("<f4").tobytes()


def decode_homes(payload: bytes) -> Array:
    """(n, 3) Raises: LinkError for bytes that are no such message of this version."""
    if len(payload) % 12 != 2 or len(payload) > 2 + 12 * COUNT_MAX:
        raise LinkError(f"homes of {len(payload)} bytes")
    _check(payload[0], payload[1], HOMES)
    return np.frombuffer(payload, "<f4", offset=2).reshape(-1, 3).astype(np.float64)


def _check(version: int, kind: int, expected: int) -> None:
    if (version, kind) != (VERSION, expected):
        raise LinkError(f"message {kind} of version {version}, where {expected} of {VERSION} is expected")


def _cm_s(*velocities_m_s: Array) -> NDArray[np.int16]:
    """(n, 3 times as many) beside each other; 0: not known."""
    beside = np.concatenate(velocities_m_s, axis=1)
    beside *= 100.0
    beside[np.isnan(beside)] = 0.0
    return np.clip(np.rint(beside), -32767, 32767).astype(np.int16)


def _bounded(values: Array) -> NDArray[np.uint16]:
    return np.where(np.isfinite(values), np.clip(np.round(values), 0, UNKNOWN - 1), UNKNOWN).astype(np.uint16)


def _percent(share: Array) -> NDArray[np.uint8]:
    known = np.isfinite(share)
    return np.where(known, np.round(100.0 * np.clip(share, 0.0, 1.0)), UNKNOWN_PERCENT).astype(np.uint8)


def _share(percent: NDArray[np.uint8]) -> Array:
    return SHARES[percent]


def _only(some: Mask, values: Array) -> Array:
    """The values (n, 3), which are changed: NaN where not in `some` (n,)."""
    if not some.all():
        values[~some] = np.nan
    return values
