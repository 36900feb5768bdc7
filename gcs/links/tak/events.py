"""Writes events of Cursor on Target: what this show sends of itself. Pure.

Source: Event-PUBLIC.xsd, version 2.0 of the schema. No text here needs to be escaped: uids and callsigns are
of letters, digits and `_ . -`.
"""

from datetime import UTC, datetime
from math import atan2, degrees, hypot, isfinite, nan
from typing import Final, NamedTuple

STALE_S: Final = 5.0
"""A track without an event for so long is out of date: five were missing."""

TYPE: Final = "a-f-A-M-H-Q"
"""Friendly, in the air, rotary wing, unmanned: the catalogue of types has no civil drones. The centre has it
as well: a thing in the air of another type counts as manned.
"""

MEASURED, FUSED = "m-g", "m-f"
"""How a place came about: a vehicle's receiver; the centre is computed."""


class OwnTrack(NamedTuple):
    """One track at one instant. What is not known is NaN."""

    uid: str
    callsign: str
    how: str
    latitude_deg: float
    longitude_deg: float
    height_m: float  # above the ellipsoid
    remarks: str
    north_m_s: float
    east_m_s: float
    deviation_m: float = nan
    height_deviation_m: float = nan
    battery: float = nan  # 0 to 1


def event(track: OwnTrack, unix_s: float) -> bytes:
    """The track as of a time since 1970."""
    time, hae = _time(unix_s), _known(track.height_m)
    ce = _known(track.deviation_m or nan)  # 0: no receiver has that, so it is not known
    le = _known(track.height_deviation_m or nan if isfinite(track.height_m) else nan)
    detail = f'<contact callsign="{track.callsign}"/>'
    if isfinite(speed_m_s := hypot(track.north_m_s, track.east_m_s)):
        course_deg = round(degrees(atan2(track.east_m_s, track.north_m_s)), 1) % 360.0
        detail += f'<track course="{course_deg:.1f}" speed="{speed_m_s:.2f}"/>'
    if isfinite(track.battery):
        detail += f'<status battery="{100.0 * track.battery:.0f}"/>'
    return (
        f'<event version="2.0" uid="{track.uid}" type="{TYPE}" how="{track.how}"'
        f' time="{time}" start="{time}" stale="{_time(unix_s + STALE_S)}">'
        f'<point lat="{track.latitude_deg:.7f}" lon="{track.longitude_deg:.7f}" hae="{hae}"'
        f' ce="{ce}" le="{le}"/>'
        f"<detail>{detail}<remarks>{track.remarks}</remarks></detail></event>\n"
    ).encode()


def _time(unix_s: float) -> str:
    return datetime.fromtimestamp(unix_s, UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"


def _known(metres: float) -> str:
    return f"{metres:.2f}" if isfinite(metres) else "9999999.0"
