"""A target that speaks MAVLink, or that a system reports by ADS-B or AIS. Listens, and never sends a byte."""

import asyncio
import logging
from collections.abc import Callable
from contextlib import aclosing
from functools import partial
from math import cos, hypot, inf, isfinite, nan, radians, sin
from typing import Final, Literal, Protocol, TypeAlias
from urllib.parse import urlsplit

import numpy as np
from pymavlink.dialects.v20 import common

from gcs.links.intake import Bound, Intake
from gcs.links.reading import datagrams
from gcs.links.targets.settings import MavlinkSource
from gcs.mavlink import codec
from gcs.mavlink.framing import GLOBAL_POSITION_INT, GPS_RAW_INT, Frame
from gcs.model.errors import LinkError
from gcs.model.target_fix import TargetFix
from gcs.model.traffic import TrackKind

log = logging.getLogger(__name__)

TELEMETRY: Final = Bound(64_000, 1000)
"""An autopilot with fast streams sends 20 kB/s in 400 messages; several may share the port."""

SILENT_S: Final = 2.0
"""Without a report for so long the reason is named."""

RETRY_S: Final = 2.0
REMEMBERED_MAX, REMEMBERED_S, SHOWN_MAX = 64, 30.0, 8
"""Systems and tracks that are remembered, for how long, and how many a text names."""

FOLLOW_TARGET: Final = 144
ADSB_VEHICLE: Final = 246
AIS_VESSEL: Final = 301

LATE_MS: Final = 10_000
"""A clock that is further behind its newest time has begun anew; up to this, a datagram was overtaken."""

ACCURACY_S: Final = 3.0
"""An older accuracy of the receiver does not count."""

OLD_S: Final = 60
"""What ADS-B or AIS have not received for longer is not where the target is."""

SPEED_MAX_M_S: Final = 350.0
ALTITUDE_MIN_M, ALTITUDE_MAX_M = -500.0, 20_000.0
KIND_OF_EMITTER: Final[dict[int, TrackKind]] = {
    common.ADSB_EMITTER_TYPE_UAV: "unmanned",
    common.ADSB_EMITTER_TYPE_EMERGENCY_SURFACE: "ground",
    common.ADSB_EMITTER_TYPE_SERVICE_SURFACE: "ground",
    common.ADSB_EMITTER_TYPE_POINT_OBSTACLE: "ground",
}
"""Any other emitter is manned, or may be."""

AIS_DEVIATION_M: Final = {True: 5.0, False: 20.0}
"""AIS says no more of its position than whether it is good to 10 m."""

_PER_DEGREE: Final = 1e7
_UNKNOWN_PLACE: Final = 2**31 - 1
_UNKNOWN_SPEED: Final = (2**15 - 1, 2**16 - 1)
_COURSES: Final = 36_000
_HAS_POSITION, _HAS_VELOCITY = 1, 2  # est_capabilities

Accuracy: TypeAlias = tuple[float, float, float]
Velocity: TypeAlias = tuple[float, float, float]
UNKNOWN: Final = (nan, nan, nan)


async def keep_receiving(
    source: MavlinkSource, take: Callable[[TargetFix], None], failed: Callable[[str], None], intake: Intake
) -> None:
    """Listen without end: give each report to `take`, why there are none to `failed`."""
    await keep_listening(source.at, partial(TargetReports, source), take, failed, intake)


class Reports(Protocol):
    """What makes reports of datagrams."""

    def take(self, data: bytes, now_s: float) -> list[TargetFix]:
        """Those of a turn. Never raises."""

    def why_silent(self, now_s: float) -> str:
        """Why no report arrived, in words; empty: one did, or the reason was given before."""


async def keep_listening(
    at: str,
    begin: Callable[[float], Reports],
    take: Callable[[TargetFix], None],
    failed: Callable[[str], None],
    intake: Intake,
) -> None:
    """Listen without end, with what `begin` makes at its time."""
    logged, clock, url = "", asyncio.get_running_loop().time, urlsplit(at)

    def name(why: str) -> None:
        nonlocal logged
        if why != logged:
            log.warning("target_interrupted", extra={"source": at, "cause": why})
        logged = why
        failed(why)

    while True:
        reports = begin(clock())
        try:
            async with aclosing(datagrams(url.hostname or "", url.port or 0, intake)) as batches:
                async for batch in batches:
                    data = b"".join(datagram.data for datagram in batch)
                    for fix in reports.take(data, clock()):
                        logged = ""
                        take(fix)
                    if why := reports.why_silent(clock()):
                        name(why)
        except (OSError, UnicodeError, ValueError) as error:  # a host's name, a port beyond the last
            name(f"{at} cannot be opened: {error}")
        await asyncio.sleep(RETRY_S)


class TargetReports:
    """Reports out of datagrams, for the one system or track that is configured. Never raises."""

    def __init__(self, source: MavlinkSource, now_s: float) -> None:
        self._source, self._track = source, source.track.upper()
        self._systems: dict[str, float] = {}  # each with its last arrival
        self._tracks: dict[str, float] = {}
        self._report_s = now_s
        self._named_s = now_s
        self._useless_s = -inf
        self._refused = ("", -inf)
        self._stream = (0, 0)  # message and component that are followed
        self._clock = BootClock()
        self._accuracy = (UNKNOWN, -inf)
        self._seen = (0, 0, inf)  # of a track: latitude, longitude, age
        self._readers = {
            GLOBAL_POSITION_INT: self._global_position,
            FOLLOW_TARGET: self._follow_target,
        }
        if self._track:
            self._readers = {ADSB_VEHICLE: self._aircraft, AIS_VESSEL: self._vessel}

    def take(self, data: bytes, now_s: float) -> list[TargetFix]:
        """The target's reports in the datagrams of a turn."""
        frames = codec.split(data).frames
        if data and not frames:
            self._useless_s = now_s
        fixes = []
        for frame in frames:
            try:
                fix = self._fix(frame, now_s)
            except LinkError as error:
                self._refused = str(error), now_s
                continue
            if fix is not None:
                self._report_s = now_s
                fixes.append(fix)
        return fixes

    def why_silent(self, now_s: float) -> str:
        """Why nothing was reported lately, in words, once a second; empty: something was."""
        if now_s - self._report_s < SILENT_S or now_s - self._named_s < 1.0:
            return ""
        self._named_s = now_s
        name = f"system {self._source.system_id}"
        others = {each: at_s for each, at_s in self._systems.items() if each != str(self._source.system_id)}
        systems, reported = _recent(others, now_s), _recent(self._tracks, now_s)
        silent_s = now_s - self._systems.get(str(self._source.system_id), -inf)
        if now_s - self._refused[1] < SILENT_S:
            return f"{name}: {self._refused[0]}"
        if silent_s < SILENT_S and self._track:
            return f"{name} does not report {self._track}; reported: {reported or 'no track'}"
        if silent_s < SILENT_S:
            return f"{name} sends neither GLOBAL_POSITION_INT nor FOLLOW_TARGET"
        if silent_s < inf:
            return f"{name} has sent nothing for {silent_s:.0f} s"
        if systems:
            return f"{name} is not received; received: {systems}"
        if now_s - self._useless_s < SILENT_S:
            return f"what arrives at {self._source.at} is not MAVLink, or damaged"
        return f"nothing arrives at {self._source.at}"

    def _fix(self, frame: Frame, now_s: float) -> TargetFix | None:
        """Raises: LinkError with what is wrong in a report of the target."""
        _remember(self._systems, str(frame.system_id), now_s)
        if frame.system_id != self._source.system_id:
            return None
        if frame.message_id == GPS_RAW_INT:
            self._accuracy = _accuracy(record_of(frame)), now_s
        reader = self._readers.get(frame.message_id)
        return None if reader is None else reader(frame, now_s)

    def _is_followed(self, frame: Frame, now_s: float) -> bool:
        """Whether this message of this component counts: clocks of several would not agree."""
        stream = frame.message_id, frame.component_id
        if stream != self._stream and now_s - self._report_s >= SILENT_S:
            self._stream, self._clock = stream, BootClock()
        if self._stream == (0, 0):
            self._stream = stream
        return stream == self._stream

    def _global_position(self, frame: Frame, now_s: float) -> TargetFix | None:
        if not self._is_followed(frame, now_s):
            return None
        record = record_of(frame)
        accuracy, accuracy_s = self._accuracy
        reported = accuracy if now_s - accuracy_s <= ACCURACY_S else UNKNOWN
        return system(record, now_s, reported, self._clock.seconds(int(record["time_boot_ms"])))

    def _follow_target(self, frame: Frame, now_s: float) -> TargetFix | None:
        if not self._is_followed(frame, now_s):
            return None
        record = record_of(frame)
        capabilities = int(record["est_capabilities"])
        if not capabilities & _HAS_POSITION:
            raise LinkError(f"FOLLOW_TARGET without a position (est_capabilities {capabilities})")
        latitude_deg, longitude_deg = place(int(record["lat"]), int(record["lon"]))
        north_m_s, east_m_s, down_m_s = map(float, record["vel"]) if capabilities & _HAS_VELOCITY else UNKNOWN
        speed_m_s = hypot(north_m_s, east_m_s, down_m_s)
        if speed_m_s > SPEED_MAX_M_S:
            raise LinkError(f"FOLLOW_TARGET with {speed_m_s:.4g} m/s; at most {SPEED_MAX_M_S:g} count")
        eph_m, epv_m = (_positive(deviation) for deviation in record["position_cov"][:2])
        stamp_ms = int(record["timestamp"])
        return TargetFix(
            now_s,
            latitude_deg,
            longitude_deg,
            _altitude_m(float(record["alt"])),
            *((north_m_s, east_m_s, down_m_s) if isfinite(speed_m_s) else UNKNOWN),
            deviation_m=eph_m,
            height_deviation_m=epv_m,
            source_s=1e-3 * stamp_ms if stamp_ms else nan,
        )

    def _aircraft(self, frame: Frame, now_s: float) -> TargetFix | None:
        record = record_of(frame)
        return self._tracked(record, aircraft, f"{int(record['ICAO_address']):06X}", now_s)

    def _vessel(self, frame: Frame, now_s: float) -> TargetFix | None:
        record = record_of(frame)
        return self._tracked(record, vessel, f"{int(record['MMSI']):09d}", now_s)

    def _tracked(
        self, record: np.void, read: Callable[[np.void, float], TargetFix], track: str, now_s: float
    ) -> TargetFix | None:
        """A report that may be old, or the same as before, which is none."""
        _remember(self._tracks, track, now_s)
        if track != self._track:
            return None
        fix = read(record, now_s)
        before, self._seen = self._seen, (int(record["lat"]), int(record["lon"]), int(record["tslc"]))
        if before[:2] == self._seen[:2] and self._seen[2] > before[2]:
            self._report_s = now_s
            return None
        return fix


class BootClock:
    """Continues a clock of 32 bits in milliseconds; one that goes back by more than `LATE_MS` begins anew."""

    def __init__(self) -> None:
        self._clock_ms: int | None = None
        self._total_ms = 0

    def seconds(self, clock_ms: int) -> float:
        """The time of a message, which others may have overtaken."""
        newest_ms = clock_ms if self._clock_ms is None else self._clock_ms
        ahead_ms = (clock_ms - newest_ms + (1 << 31)) % (1 << 32) - (1 << 31)
        if self._clock_ms is None or ahead_ms < -LATE_MS:
            self._clock_ms = self._total_ms = clock_ms
        elif ahead_ms > 0:
            self._clock_ms, self._total_ms = clock_ms, self._total_ms + ahead_ms
        else:
            return 1e-3 * (self._total_ms + ahead_ms)
        return 1e-3 * self._total_ms


def system(
    record: np.void,
    now_s: float,
    accuracy: Accuracy = UNKNOWN,
    source_s: float = nan,
    *,
    track: str = "",
    kind: TrackKind | Literal[""] = "",
) -> TargetFix:
    """A report of GLOBAL_POSITION_INT. Raises: LinkError with why it is none."""
    latitude_deg, longitude_deg = place(int(record["lat"]), int(record["lon"]))
    moves = [int(record[axis]) for axis in ("vx", "vy", "vz")]
    is_unknown = any(speed in _UNKNOWN_SPEED for speed in moves)
    north_m_s, east_m_s, down_m_s = UNKNOWN if is_unknown else (0.01 * speed for speed in moves)
    return TargetFix(
        now_s,
        latitude_deg,
        longitude_deg,
        _altitude_m(_millimetres(record["alt"])),
        north_m_s,
        east_m_s,
        down_m_s,
        *accuracy,
        source_s,
        track,
        kind,
    )


def aircraft(record: np.void, now_s: float) -> TargetFix:
    """A report of ADSB_VEHICLE. Raises: LinkError with why it is none."""
    has, flags, track = common, int(record["flags"]), f"{int(record['ICAO_address']):06X}"
    if not flags & has.ADSB_FLAGS_VALID_COORDS:
        raise LinkError(f"{track} without a valid position (flags {flags})")
    altitude_m = _millimetres(record["altitude"]) if flags & has.ADSB_FLAGS_VALID_ALTITUDE else nan
    is_height = int(record["altitude_type"]) == has.ADSB_ALTITUDE_TYPE_GEOMETRIC  # a pressure is none
    moves = has.ADSB_FLAGS_VALID_HEADING | has.ADSB_FLAGS_VALID_VELOCITY
    course = int(record["heading"]) if flags & moves == moves else _COURSES
    climb = int(record["ver_velocity"]) if flags & has.ADSB_FLAGS_VERTICAL_VELOCITY_VALID else None
    return _received(
        record,
        now_s,
        track,
        KIND_OF_EMITTER.get(int(record["emitter_type"]), "manned"),
        altitude_m=_altitude_m(altitude_m) if is_height else nan,
        pressure_altitude_m=nan if is_height else altitude_m,
        velocity=_along(course, int(record["hor_velocity"]), climb),
    )


def vessel(record: np.void, now_s: float, old_s: float = OLD_S) -> TargetFix:
    """A report of AIS_VESSEL, at most `old_s` old. Raises: LinkError with why it is none."""
    has, flags = common, int(record["flags"])
    moves = has.AIS_FLAGS_VALID_COG | has.AIS_FLAGS_VALID_VELOCITY
    is_moving = flags & (moves | has.AIS_FLAGS_HIGH_VELOCITY) == moves  # else faster than AIS can say
    return _received(
        record,
        now_s,
        f"{int(record['MMSI']):09d}",
        "vessel",
        velocity=_along(int(record["COG"]) if is_moving else _COURSES, int(record["velocity"]), None),
        deviation_m=AIS_DEVIATION_M[bool(flags & has.AIS_FLAGS_POSITION_ACCURACY)],
        old_s=old_s,
    )


def _received(
    record: np.void,
    now_s: float,
    track: str,
    kind: TrackKind,
    *,
    velocity: Velocity,
    altitude_m: float = nan,
    pressure_altitude_m: float = nan,
    deviation_m: float = nan,
    old_s: float = OLD_S,
) -> TargetFix:
    """A report of what a system has received some seconds ago."""
    age_s = int(record["tslc"])
    latitude_deg, longitude_deg = place(int(record["lat"]), int(record["lon"]))
    if age_s > old_s:
        raise LinkError(f"{track} was received {age_s} s ago (tslc); at most {old_s:g} s count")
    return TargetFix(
        now_s,
        latitude_deg,
        longitude_deg,
        altitude_m,
        *velocity,
        deviation_m=deviation_m,
        source_s=now_s - age_s,
        track=track,
        kind=kind,
        pressure_altitude_m=pressure_altitude_m,
    )


def place(latitude: int, longitude: int) -> tuple[float, float]:
    """Degrees of a position in 1e-7 degrees. Raises: LinkError with why it is none."""
    if _UNKNOWN_PLACE in {latitude, longitude}:
        raise LinkError("the position is reported as unknown (2147483647)")
    if latitude == longitude == 0:
        raise LinkError("the position is 0, 0: none is known yet")
    latitude_deg, longitude_deg = latitude / _PER_DEGREE, longitude / _PER_DEGREE
    if abs(latitude_deg) > 90.0 or abs(longitude_deg) > 180.0:
        raise LinkError(f"the position {latitude_deg:.7f}, {longitude_deg:.7f} is out of range")
    return latitude_deg, longitude_deg


def _altitude_m(altitude_m: float) -> float:
    """As reported, NaN where unknown. Raises: LinkError out of range."""
    if isfinite(altitude_m) and not ALTITUDE_MIN_M <= altitude_m <= ALTITUDE_MAX_M:
        limits = f"from {ALTITUDE_MIN_M:g} to {ALTITUDE_MAX_M:g} m counts"
        raise LinkError(f"the altitude {altitude_m:.6g} m is out of range; {limits}")
    return altitude_m if isfinite(altitude_m) else nan


def _millimetres(altitude: np.int32) -> float:
    return nan if int(altitude) == _UNKNOWN_PLACE else 1e-3 * int(altitude)


def _along(course: int, speed: int, climb: int | None) -> Velocity:
    """Velocity from 0.01 degrees and 0.01 m/s; NaN where unknown."""
    down_m_s = nan if climb is None or climb in _UNKNOWN_SPEED else -0.01 * climb
    if course >= _COURSES or speed in _UNKNOWN_SPEED:
        return nan, nan, down_m_s
    angle = radians(0.01 * course)
    return 0.01 * speed * cos(angle), 0.01 * speed * sin(angle), down_m_s


def _accuracy(record: np.void) -> Accuracy:
    """Deviations sideways and up in m, and of the velocity in m/s, of GPS_RAW_INT; 0: not reported."""
    return (
        _positive(1e-3 * int(record["h_acc"])),
        _positive(1e-3 * int(record["v_acc"])),
        _positive(1e-3 * int(record["vel_acc"])),
    )


def _positive(deviation: float) -> float:
    return float(deviation) if 0.0 < deviation < 1e6 else nan  # 4294967.295: unknown


def record_of(frame: Frame) -> np.void:
    """The fields of a frame: bytes that MAVLink 2 cut off are 0, those of newer definitions are left out."""
    dtype = codec.layout(frame.message_id).dtype
    record: np.void = np.frombuffer(frame.payload.ljust(dtype.itemsize, b"\0"), dtype, 1)[0]
    return record


def _remember(names: dict[str, float], name: str, now_s: float) -> None:
    names.pop(name, None)
    names[name] = now_s  # the newest is the last
    if len(names) > REMEMBERED_MAX:
        names.pop(next(iter(names)))


def _recent(names: dict[str, float], now_s: float) -> str:
    """Names of which something arrived lately, the first few in their order."""
    recent = sorted((name for name, at_s in names.items() if now_s - at_s < REMEMBERED_S), key=_in_order)
    more = f" and {len(recent) - SHOWN_MAX} more" if len(recent) > SHOWN_MAX else ""
    return ", ".join(recent[:SHOWN_MAX]) + more


def _in_order(name: str) -> tuple[int, str]:
    return len(name), name
