"""Numbers, times and names of sources that are not trusted. Pure."""

from datetime import UTC, datetime
from math import cos, hypot, isfinite, nan, radians, sin
from typing import Final

from gcs.model.errors import cut

ALTITUDE_M: Final = (-1000.0, 20_000.0)
SPEED_MAX_M_S: Final = 500.0
DEVIATION_MAX_M: Final = 1e5

_CHARACTERS: Final = 40
_SHOWN: Final = 3


def within(value: object, least: float, most: float) -> float:
    """A number, or text with one, between two bounds; NaN for all else."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return nan
    if isinstance(value, str) and len(value) > _CHARACTERS:
        return nan
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return nan
    return number if least <= number <= most else nan


def why_nowhere(latitude_deg: object, longitude_deg: object) -> str:
    """Why these are no place on Earth; empty: they are."""
    for name, value, most in (("latitude", latitude_deg, 90.0), ("longitude", longitude_deg, 180.0)):
        if not isfinite(within(value, -most, most)):
            return f"{name} {cut(str(value))} is not within {most:g} degrees"
    return ""


def velocity(speed_m_s: object, course_deg: object) -> tuple[float, float]:
    """Towards north and east, of a course over ground from true north; NaN without either."""
    speed = within(speed_m_s, 0.0, SPEED_MAX_M_S)
    course = radians(within(course_deg, -360.0, 360.0))
    return (0.0, 0.0) if speed == 0.0 else (speed * cos(course), speed * sin(course))


def deviation(value: object, unit: float = 1.0) -> float:
    """A standard deviation of `unit` times so much; NaN for what no estimate can be, as 0."""
    number = within(value, 0.0, DEVIATION_MAX_M)
    return unit * number if number > 0.0 else nan


def wider(one: float, other: float) -> float:
    """The greater of two deviations; NaN unless both are numbers."""
    return max(one, other) if isfinite(hypot(one, other)) else nan


def first_known(*numbers: float) -> float:
    """NaN: none is a number."""
    return next((number for number in numbers if isfinite(number)), nan)


def utc_s(text: object) -> float:
    """Seconds since 1970 of a time as of ISO 8601; NaN for all else."""
    if not isinstance(text, str) or len(text) > _CHARACTERS:
        return nan
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return nan
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()


class Names:
    """The first names that a source sends, up to a bound: whatever it sends, memory stays bounded."""

    KEPT: Final = 64

    def __init__(self) -> None:
        self._names: dict[str, None] = {}

    def add(self, name: str) -> None:
        if len(self._names) < self.KEPT:
            self._names[cut(name)] = None

    def __str__(self) -> str:
        names = list(self._names)
        rest, full = len(names) - _SHOWN, len(names) == self.KEPT
        more = f" (and {'at least ' if full else ''}{rest} more)" if rest > 0 else ""
        return ", ".join(names[:_SHOWN]) + more
