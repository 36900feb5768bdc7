"""Reports as bytes, in the format of each source. Sans-I/O.

NMEA 0183: GGA, RMC, GST. gpsd: https://gpsd.gitlab.io/gpsd/gpsd_json.html. Cursor on Target: event 2.0.
"""

import json
from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from functools import reduce
from math import hypot, isnan
from operator import xor
from typing import TypeAlias
from xml.sax.saxutils import quoteattr

from pymavlink.dialects.v20 import common

from gcs.sim.protocol.frames import Message
from gcs.sim.targets.motions import State, course_deg
from gcs.sim.targets.reports import Report

GEOID_M = 47.0
"""Mean sea level above the ellipsoid, where `Origin` is."""

KNOT_M_S = 1852.0 / 3600.0
STALE_S = 10.0
DEVICE = "/dev/ttyFAKE0"
UNKNOWN = 2**31 - 1
HEARTBEAT_S = 1.0
BOOTED_S = 60.0
"""How long a target's autopilot has run at the beginning."""

Encoder: TypeAlias = Callable[[Report], bytes]


def _moment(unix_s: float) -> datetime:
    return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=unix_s)


def _stamp(moment: datetime) -> str:
    return moment.strftime("%Y-%m-%dT%H:%M:%S.") + f"{moment.microsecond // 1000:03d}Z"


def _over_ground(report: Report) -> tuple[float, float]:
    """Speed in m/s and course in degrees."""
    state = State(0.0, 0.0, 0.0, report.north_m_s, report.east_m_s, report.down_m_s)
    return hypot(report.north_m_s, report.east_m_s), course_deg(state)


def nmea(unix_s: float) -> Encoder:
    """Three sentences a report; `unix_s` is the receiver's time at its clock's 0."""

    def encode(report: Report) -> bytes:
        moment, (speed_m_s, course) = _moment(unix_s + report.clock_s), _over_ground(report)
        clock = moment.strftime("%H%M%S.") + f"{moment.microsecond // 10_000:02d}"
        place = f"{_angle(report.latitude_deg, 2, 'NS')},{_angle(report.longitude_deg, 3, 'EW')}"
        spread = f"{report.deviation_m:.3f}"
        sentences = [
            f"GNGGA,{clock},{place},1,12,0.8,{report.altitude_amsl_m:.3f},M,{GEOID_M:.1f},M,,",
            f"GNRMC,{clock},A,{place},{speed_m_s / KNOT_M_S:.3f},{course:.2f},{moment:%d%m%y},,,A",
            f"GNGST,{clock},{spread},{spread},{spread},0.0,{spread},{spread},{1.5 * report.deviation_m:.3f}",
        ]
        return b"".join(f"${text}*{reduce(xor, text.encode()):02X}\r\n".encode() for text in sentences)

    return encode


def _angle(angle_deg: float, digits: int, signs: str) -> str:
    """Degrees and minutes, and the hemisphere."""
    if isnan(angle_deg):
        return f"nan,{signs[0]}"
    whole, minutes = divmod(round(abs(angle_deg) * 60.0, 6), 60.0)
    return f"{int(whole):0{digits}d}{minutes:09.6f},{signs[angle_deg < 0.0]}"


def tpv(unix_s: float) -> Encoder:
    """A line of gpsd for a report."""

    def encode(report: Report) -> bytes:
        speed_m_s, course = _over_ground(report)
        values = {
            "class": "TPV",
            "device": DEVICE,
            "mode": 3,
            "time": _stamp(_moment(unix_s + report.clock_s)),
            "lat": report.latitude_deg,
            "lon": report.longitude_deg,
            "altHAE": report.altitude_amsl_m + GEOID_M,
            "altMSL": report.altitude_amsl_m,
            "alt": report.altitude_amsl_m,
            "geoidSep": GEOID_M,
            "epx": report.deviation_m,
            "epy": report.deviation_m,
            "epv": 1.5 * report.deviation_m,
            "track": course,
            "speed": speed_m_s,
            "climb": -report.down_m_s,
        }
        return line(values)

    return encode


def line(values: Mapping[str, object]) -> bytes:
    return json.dumps(values, separators=(",", ":")).encode() + b"\r\n"


def cot(unix_s: float, name: str) -> Encoder:
    """An event for a report."""
    uid = quoteattr(name)

    def encode(report: Report) -> bytes:
        moment, (speed_m_s, course) = _moment(unix_s + report.clock_s), _over_ground(report)
        stale = _stamp(moment + timedelta(seconds=STALE_S))
        return (
            '<?xml version="1.0" encoding="UTF-8"?>'
            f'<event version="2.0" uid={uid} type="a-f-G-U-C" how="m-g" time="{_stamp(moment)}"'
            f' start="{_stamp(moment)}" stale="{stale}">'
            f'<point lat="{report.latitude_deg:.9f}" lon="{report.longitude_deg:.9f}"'
            f' hae="{report.altitude_amsl_m + GEOID_M:.3f}" ce="{report.deviation_m:.3f}"'
            f' le="{1.5 * report.deviation_m:.3f}"/>'
            f"<detail><contact callsign={uid}/>"
            f'<track course="{course:.2f}" speed="{speed_m_s:.3f}"/></detail></event>'
        ).encode()

    return encode


class Mavlink:
    """Frames of a system of its own.

    GLOBAL_POSITION_INT or FOLLOW_TARGET; once a second HEARTBEAT and GPS_RAW_INT.
    """

    def __init__(self, system_id: int, *, follow_target: bool = False) -> None:
        self._mav = common.MAVLink(None, srcSystem=system_id, srcComponent=1)
        self._position = self._follow_target if follow_target else self._global_position
        self._beat_s = -HEARTBEAT_S

    def __call__(self, report: Report) -> bytes:
        messages = [self._position(report)]
        if report.sent_s - self._beat_s >= HEARTBEAT_S:
            self._beat_s = report.sent_s
            messages[:0] = [
                common.MAVLink_heartbeat_message(
                    common.MAV_TYPE_GROUND_ROVER, common.MAV_AUTOPILOT_GENERIC, 0, 0, 4, 3
                ),
                self._receiver(report),
            ]
        return b"".join(self._packed(message) for message in messages)

    def _packed(self, message: Message) -> bytes:
        packed = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return packed

    def _global_position(self, report: Report) -> Message:
        latitude, longitude, altitude_mm = _place(report)
        course = round(100 * _over_ground(report)[1]) % 36_000
        velocity = report.north_m_s, report.east_m_s, report.down_m_s
        moves = [max(-32_767, min(round(100 * speed), 32_766)) for speed in velocity]
        return common.MAVLink_global_position_int_message(
            _boot_ms(report) % 2**32, latitude, longitude, altitude_mm, 0, *moves, course
        )

    def _follow_target(self, report: Report) -> Message:
        latitude, longitude, _ = _place(report)
        velocity = [report.north_m_s, report.east_m_s, report.down_m_s]
        spread = [report.deviation_m, 1.5 * report.deviation_m, 0.0]
        nothing = [0.0, 0.0, 0.0]
        return common.MAVLink_follow_target_message(
            _boot_ms(report), 3, latitude, longitude, report.altitude_amsl_m, velocity, nothing,
            [1.0, *nothing], nothing, spread, 0,
        )  # fmt: skip

    def _receiver(self, report: Report) -> Message:
        spread_mm, (speed_m_s, course) = round(1000 * report.deviation_m), _over_ground(report)
        return common.MAVLink_gps_raw_int_message(
            1000 * _boot_ms(report),
            3,
            *_place(report),
            80,
            120,
            min(round(100 * speed_m_s), 65_534),
            round(100 * course),
            12,
            h_acc=spread_mm,
            v_acc=round(1.5 * spread_mm),
            vel_acc=max(round(0.05 * spread_mm), 1),
        )


class Transponder(Mavlink):
    """Frames of a receiver of ADS-B or AIS that reports one aircraft or vessel."""

    def __init__(self, system_id: int, track: int, *, vessel: bool = False) -> None:
        super().__init__(system_id)
        self._track, self._position = track, self._vessel if vessel else self._aircraft

    def _aircraft(self, report: Report) -> Message:
        speed_m_s, course = _over_ground(report)
        climb = max(-32_767, min(round(-100 * report.down_m_s), 32_766))
        flags = (
            common.ADSB_FLAGS_VALID_COORDS
            | common.ADSB_FLAGS_VALID_ALTITUDE
            | common.ADSB_FLAGS_VALID_HEADING
            | common.ADSB_FLAGS_VALID_VELOCITY
            | common.ADSB_FLAGS_VERTICAL_VELOCITY_VALID
        )
        return common.MAVLink_adsb_vehicle_message(
            self._track, *_place(report)[:2], common.ADSB_ALTITUDE_TYPE_GEOMETRIC, _place(report)[2],
            round(100 * course) % 36_000, min(round(100 * speed_m_s), 65_534), climb, b"FAKE",
            common.ADSB_EMITTER_TYPE_SMALL, 0, flags, 0,
        )  # fmt: skip

    def _vessel(self, report: Report) -> Message:
        speed_m_s, course = _over_ground(report)
        flags = (
            common.AIS_FLAGS_POSITION_ACCURACY | common.AIS_FLAGS_VALID_COG | common.AIS_FLAGS_VALID_VELOCITY
        )
        return common.MAVLink_ais_vessel_message(
            self._track, *_place(report)[:2], round(100 * course) % 36_000, 0,
            min(round(100 * speed_m_s), 65_534), 0, 0, 0, 10, 10, 2, 2, b"", b"FAKE", 0, flags,
        )  # fmt: skip


def _boot_ms(report: Report) -> int:
    return max(round(1000 * (BOOTED_S + report.clock_s)), 0)


def _place(report: Report) -> tuple[int, int, int]:
    if isnan(report.latitude_deg):
        return UNKNOWN, UNKNOWN, UNKNOWN
    return (
        round(1e7 * report.latitude_deg),
        round(1e7 * report.longitude_deg),
        round(1000 * report.altitude_amsl_m),
    )
