"""What stations send each other once a tick, as bytes: little-endian, versioned, without absolute times.

`StateBatch`: a head, one echo for each station received, one row of `ROW` for each vehicle of the station.
`FormationMessage` and `SlotsMessage`: what the leading station computes for the whole formation.
"""

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final, NamedTuple, TypeAlias
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json, to_json

from gcs.formation.orbit import Center
from gcs.model.errors import LinkError
from gcs.model.jit import kernel
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array, Mask, Mode, VehicleId
from gcs.model.vehicle_columns import SENT

Codes: TypeAlias = NDArray[np.uint8]

VERSION: Final = 4

STATES, FORMATION, SLOTS, HOMES, VELOCITIES = 1, 2, 3, 4, 6
"""Kinds of messages."""

PHASES: Final = tuple(Phase)
SHOW_PHASES: Final = tuple(ShowPhase)
MODES: Final = tuple(Mode)
"""Numbers on the wire are places in these."""

_PHASES, _MODES = len(PHASES), len(MODES)

PHASE_CODE: Final = {phase: number for number, phase in enumerate(PHASES)}
MODE_CODE: Final = {mode: number for number, mode in enumerate(MODES)}

ALL_UP = 1
"""Flag of a station."""

EPOCH_MAX: Final = 255

UNKNOWN: Final = 0xFFFF
UNKNOWN_STEPS: Final = 0xFF

AIRBORNE, FORMED, SLOT_STAYS, ARMED, READY, OWNED, COMMANDED = (1 << bit for bit in range(7))
"""Flags of a vehicle."""

ROW: Final = np.dtype(
    [
        ("position_m", "<f4", 3),  # NaN: never received
        # velocity; the one before the safety filter; the desired one after it, flown to by the newest
        # setpoint; that setpoint, without the trim
        ("motion_cm_s", "<i2", 12),
        ("epoch", "u1"),  # of its ownership: a station that takes vehicles over counts on
        ("phase", "u1"),
        ("flags", "u1"),
        ("mode", "u1"),
        ("uncertainty_cm", "<u2"),
        ("age_ms", "<u2"),  # of the position when the batch was made
        ("yaw", "<i2"),  # 1 / 10,000 rad
        ("numbers", "u1", len(SENT)),  # steps of each number of `SENT`
    ]
)

_STATION: Final = struct.Struct("<BBHIIIHBBff")
_ECHO: Final = struct.Struct("<HIf")
_FORMATION: Final = struct.Struct("<BBIIHIBBff9d")
_SLOTS: Final = struct.Struct("<BBIIHH")
SLOT_STEPS: Final = 32767.0
COUNT_MAX: Final = min(1200, (60_000 - _STATION.size - 1 - 99 * _ECHO.size) // ROW.itemsize)
"""Vehicles of one station: their batch stays below 60,000 bytes."""

_STEPS: Final = np.array([*SENT.values()])  # (k, 2) step and least of each number sent

SIDES_MAX: Final = 20_000
"""Bytes of the sides on which obstacles are passed."""


def site_number(fleets: Mapping[str, tuple[VehicleId, ...]]) -> int:
    """A number of the site's stations, vehicles and numbers sent: stations with others ignore each other."""
    return crc32(json.dumps([*fleets.items(), SENT]).encode())


class Echo(NamedTuple):
    """The newest batch that a station received from another: by it that one measures the delay."""

    station: int  # place among the site's stations
    sequence: int
    held_s: float  # since its arrival


class BatchHead(NamedTuple):
    """What a station reports of itself at one tick."""

    sequence: int
    site: int  # see `site_number`
    term: int  # of the lead that it obeys
    lead: int  # place among the site's stations
    show: ShowPhase
    all_up: bool  # no vehicle of it climbs, or waits for its turn to take off
    pace: float
    return_s: float  # time in the plan of the collective return, NaN: none is flown
    echoes: tuple[Echo, ...]

    def encode(self, vehicles: int) -> bytes:
        """The bytes before the rows of so many vehicles: 29, and 10 for each echo."""
        show, flags = SHOW_PHASES.index(self.show), ALL_UP * self.all_up
        head = (VERSION, STATES, vehicles, self.sequence, self.site, self.term, self.lead, show, flags)
        echoes = [_ECHO.pack(echo.station, echo.sequence, echo.held_s) for echo in self.echoes]
        return b"".join([_STATION.pack(*head, self.pace, self.return_s), bytes([len(echoes)]), *echoes])


class StateBatch(NamedTuple):
    """One station and its n vehicles at one tick, show frame. Owns its arrays."""

    head: BatchHead
    position_m: Array  # (n, 3) brought forward as in FleetState; of silent vehicles the last one
    velocity_m_s: Array  # (n, 3)
    unfiltered_m_s: Array  # (n, 3) what the safety filter was given, NaN: not commanded
    desired_m_s: Array  # (n, 3) what it made of that, NaN: not commanded
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
    numbers: Sequence[Array]  # (n,) each, those of `SENT`

    def encode(self) -> bytes:
        """The bytes: the head, and a row for each vehicle."""
        velocities = (self.velocity_m_s, self.unfiltered_m_s, self.desired_m_s, self.setpoint_m_s)
        columns = (self.uncertainty_m, self.age_s, self.yaw_rad, *self.numbers)
        masks = (self.airborne, self.formed, self.slot_stays, self.armed, self.ready, self.owned)
        codes = (*masks, self.phases, self.modes, self.epochs)
        # put together first: the compiled code then always gets the same kinds of arrays
        motion = np.concatenate([self.position_m, *velocities], axis=1)
        rows = np.empty(len(motion), ROW)
        _pack(rows, motion, np.concatenate(columns), _STEPS, np.concatenate(codes))
        return self.head.encode(len(motion)) + rows.tobytes()


def numbers_of(steps: Codes) -> dict[str, Array]:
    """The numbers of `SENT`, of (n, k) steps as in `ROW`; NaN: not known."""
    values = np.where(steps == UNKNOWN_STEPS, np.nan, _STEPS[:, 1] + _STEPS[:, 0] * steps)
    return dict(zip(SENT, values.T, strict=True))


def decode_batch(payload: bytes) -> tuple[BatchHead, NDArray[np.void]]:
    """A station, and (n,) rows of `ROW`, of its vehicles. Raises: LinkError for bytes that are no batch."""
    if len(payload) < _STATION.size + 1:
        raise LinkError(f"a batch of {len(payload)} bytes is too short")
    version, kind, n, sequence, site, term, lead, show, flags, pace, return_s = _STATION.unpack_from(payload)
    _check(version, kind, STATES)
    begin = _STATION.size + 1 + payload[_STATION.size] * _ECHO.size
    if len(payload) != begin + n * ROW.itemsize or show >= len(SHOW_PHASES) or not isfinite(pace):
        raise LinkError(f"a batch of {len(payload)} bytes for {n} vehicles")
    echoes = tuple(map(Echo._make, _ECHO.iter_unpack(payload[_STATION.size + 1 : begin])))
    rows = np.frombuffer(payload, ROW, offset=begin)
    if not _exist(rows):
        raise LinkError("a batch with a phase or mode that does not exist")
    pace = min(max(pace, 0.0), 1.0)
    head = BatchHead(
        sequence, site, term, lead, SHOW_PHASES[show], bool(flags & ALL_UP), pace, return_s, echoes
    )
    return head, rows


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
        return _FORMATION.pack(*head, self.radius_m, self.spin_rad_s, *numbers) + to_json(self.sides)

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
        steps = np.frombuffer(payload, "<i2", offset=_SLOTS.size).reshape(count, 3)
        return SlotsMessage(site, term, lead, _directions(steps))


@dataclass(frozen=True, slots=True, eq=False)
class VelocitiesMessage:
    """Velocities of one station's vehicles by a law that the lead computes for all. Owns its array."""

    site: int
    term: int
    lead: int  # place among the site's stations
    velocity_m_s: Array  # (n, 3) relative to the centre; NaN: not in formation there, or all hold

    def encode(self) -> bytes:
        head = (VERSION, VELOCITIES, self.site, self.term, self.lead, len(self.velocity_m_s))
        return _SLOTS.pack(*head) + self.velocity_m_s.astype("<f4").tobytes()

    @staticmethod
    def decode(payload: bytes) -> "VelocitiesMessage":
        """Raises: LinkError for bytes that are no such message of this version."""
        if len(payload) < _SLOTS.size:
            raise LinkError(f"velocities of {len(payload)} bytes are too short")
        version, kind, site, term, lead, count = _SLOTS.unpack_from(payload)
        _check(version, kind, VELOCITIES)
        if len(payload) != _SLOTS.size + 12 * count:
            raise LinkError(f"velocities of {len(payload)} bytes for {count} vehicles")
        sent_m_s = np.frombuffer(payload, "<f4", offset=_SLOTS.size).reshape(count, 3).astype(np.float64)
        finite = np.isfinite(sent_m_s).all(axis=1, keepdims=True)
        return VelocitiesMessage(site, term, lead, np.where(finite, sent_m_s, np.nan))


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


@kernel
def _exist(rows: NDArray[np.void]) -> bool:
    """Whether all phases and modes in rows of `ROW` are places in `PHASES` and `MODES`."""
    exist = True
    for i in range(len(rows)):
        exist &= rows[i].phase < _PHASES and rows[i].mode < _MODES
    return exist


@kernel
def _directions(steps: NDArray[np.int16]) -> Array:
    """(n, 3) unit vectors of (n, 3) steps; NaN: none."""
    place = np.empty(steps.shape)
    for i in range(len(steps)):
        x, y, z = float(steps[i, 0]), float(steps[i, 1]), float(steps[i, 2])
        length = np.sqrt(x * x + y * y + z * z)
        if not length > SLOT_STEPS / 2:
            length = np.nan
        place[i, 0], place[i, 1], place[i, 2] = x / length, y / length, z / length
    return place


@kernel
def _pack(
    rows: NDArray[np.void],
    motion: Array,
    columns: Array,
    steps: Array,
    codes: NDArray[np.uint8],
) -> None:
    """Fill the rows of a batch.

    Args:
        rows: (n,) of `ROW`, all fields set. An argument, so that compiled code notices another `ROW`.
        motion: (n, 15) position, velocity, velocity before the safety filter and after it, setpoint.
        columns: ((3 + k) n,) uncertainty, age, yaw, and the numbers of `SENT`.
        steps: (k, 2) step and least of those.
        codes: (9 n,) masks in the order of the flags, phase, mode, epoch.
    """
    n = len(motion)
    position_m, motion_cm_s, flags = rows["position_m"], rows["motion_cm_s"], rows["flags"]
    numbers = rows["numbers"]
    for i in range(n):
        for axis in range(3):
            position_m[i, axis] = motion[i, axis]
        for axis in range(12):
            motion_cm_s[i, axis] = _cm_s(motion[i, 3 + axis])
        flags[i] = COMMANDED if np.isfinite(motion[i, 9]) else 0
        for bit in range(6):
            flags[i] |= codes[bit * n + i] << bit
        rows[i].phase, rows[i].mode, rows[i].epoch = codes[6 * n + i], codes[7 * n + i], codes[8 * n + i]
        rows[i].uncertainty_cm = _bounded(100.0 * columns[i])
        rows[i].age_ms = _bounded(1000.0 * columns[n + i])
        yaw_rad = columns[2 * n + i]
        rows[i].yaw = 0 if np.isnan(yaw_rad) else int(np.rint(1e4 * yaw_rad))
        for k in range(len(steps)):
            numbers[i, k] = _in_steps((columns[(3 + k) * n + i] - steps[k, 1]) / steps[k, 0])


@kernel
def _cm_s(velocity_m_s: float) -> int:
    """0: not known."""
    if np.isnan(velocity_m_s):
        return 0
    return int(np.rint(min(max(100.0 * velocity_m_s, -32767.0), 32767.0)))


@kernel
def _bounded(value: float) -> int:
    """In whole numbers; UNKNOWN where it is not finite."""
    if not np.isfinite(value):
        return UNKNOWN
    return int(np.rint(min(max(value, 0.0), UNKNOWN - 1.0)))


@kernel
def _in_steps(value: float) -> int:
    if not np.isfinite(value):
        return UNKNOWN_STEPS
    return int(np.rint(min(max(value, 0.0), UNKNOWN_STEPS - 1.0)))
