"""Writes an event of Cursor on Target, for stations that show tracks as TAK does. Pure."""

from datetime import UTC, datetime, timedelta
from math import atan2, degrees, hypot, isfinite
from typing import Final
from xml.sax.saxutils import quoteattr

from gcs.model.errors import cut
from gcs.model.target_fix import TargetFix

QUADROTOR: Final = "a-f-A-M-H-Q"
"""A friendly aircraft: military, rotary wing, without a pilot."""

UNKNOWN: Final = 9_999_999.0
_TIME: Final = "%Y-%m-%dT%H:%M:%S.%fZ"


def event(
    fix: TargetFix, uid: str, callsign: str, *, geoid_m: float, stale_s: float, kind: str = QUADROTOR
) -> bytes:
    """An event of what was where at `source_s`, UTC since 1970.

    Args:
        fix: NaN is written as unknown; its place and time are known.
        uid: stays the same for each track.
        callsign: what is shown.
        geoid_m: height of the geoid above the WGS84 ellipsoid there; NaN: heights are unknown.
        stale_s: the event counts for so long.
        kind: the type of the schema.
    """
    time = datetime.fromtimestamp(fix.source_s, UTC)
    times = {"time": time, "start": time, "stale": time + timedelta(seconds=stale_s)}
    head = {"version": "2.0", "uid": uid, "type": kind, "how": "m-g"}
    head |= {name: moment.strftime(_TIME) for name, moment in times.items()}
    point = {"lat": f"{fix.latitude_deg:.8f}", "lon": f"{fix.longitude_deg:.8f}"}
    errors = {"hae": fix.altitude_amsl_m + geoid_m, "ce": fix.deviation_m, "le": fix.height_deviation_m}
    point |= {name: f"{value if isfinite(value) else UNKNOWN:.2f}" for name, value in errors.items()}
    detail = _element("contact", {"callsign": callsign})
    speed_m_s = hypot(fix.north_m_s, fix.east_m_s)
    if isfinite(speed_m_s):
        course_deg = degrees(atan2(fix.east_m_s, fix.north_m_s)) % 360.0
        detail += _element("track", {"course": f"{course_deg:.2f}", "speed": f"{speed_m_s:.3f}"})
    content = f"{_element('point', point)}<detail>{detail}</detail>"
    return f'<?xml version="1.0" encoding="UTF-8"?>{_element("event", head, content)}'.encode()


def _element(name: str, attributes: dict[str, str], content: str = "") -> str:
    written = " ".join(f"{key}={quoteattr(cut(value))}" for key, value in attributes.items())
    return f"<{name} {written}>{content}</{name}>"
