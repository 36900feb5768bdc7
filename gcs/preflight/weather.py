"""The weather before a start, as somebody entered it, against the limits of the configuration."""

from collections.abc import Iterator
from typing import Final, NamedTuple

from gcs.links.features import WeatherLimits
from gcs.model.errors import InvalidError
from gcs.model.preflight_report import Check, State
from gcs.service.go import WeatherEntry


class _Quantity(NamedTuple):
    field: str
    name: str  # of its check
    unit: str
    limit: str  # field of the settings
    most: float  # that can be entered


QUANTITIES: Final = (
    _Quantity("wind_m_s", "wind", "m/s", "wind_max_m_s", 100.0),
    _Quantity("gust_m_s", "gusts", "m/s", "gust_max_m_s", 100.0),
    _Quantity("visibility_m", "visibility", "m", "visibility_min_m", 100_000.0),
    _Quantity("kp", "Kp", "", "kp_max", 9.0),
)

TO_DO: Final = "look again, and enter it: gcs weather"


def check_entry(entry: WeatherEntry) -> None:
    """Raises: InvalidError for a value that no instrument shows, or an entry without any."""
    values = {each.field: getattr(entry, each.field) for each in QUANTITIES}
    if all(value is None for value in values.values()):
        raise InvalidError("weather", "nothing", f"at least one of {', '.join(values)}")
    for each in QUANTITIES:
        value = values[each.field]
        if value is not None and not 0.0 <= value <= each.most:  # written so that NaN is refused
            raise InvalidError(each.field, value, f"from 0 to {each.most:g}")


def weather_checks(limits: WeatherLimits, entry: WeatherEntry | None, age_s: float) -> Iterator[Check]:
    """Yield one check for each limit that is set; what is unknown or old does not pass.

    Args:
        limits: of the configuration.
        entry: the newest; None: none was made since the service began.
        age_s: since it was made, by a clock that is not set.
    """
    for each in QUANTITIES:
        limit = getattr(limits, each.limit)
        if limit is not None:
            yield _check(each, limit, entry, age_s, limits.age_max_s)


def _check(each: _Quantity, limit: float, entry: WeatherEntry | None, age_s: float, most_s: float) -> Check:
    is_least = each.field == "visibility_m"
    unit = f" {each.unit}" if each.unit else ""
    allowed = (
        f"{'at least' if is_least else 'at most'} {limit:g}{unit}, entered {most_s / 60.0:g} min ago or later"
    )
    value = None if entry is None else getattr(entry, each.field)
    if entry is None or value is None:
        return Check(each.name, State.UNKNOWN, None, each.unit, allowed, f"{each.name}: not known", TO_DO)
    if not 0.0 <= age_s <= most_s:
        when = f"{age_s / 60.0:.0f} min ago" if age_s >= 0.0 else "at an unknown time"
        problem = f"{each.name}: entered by {entry.by} {when}"
        return Check(each.name, State.UNKNOWN, value, each.unit, allowed, problem, TO_DO)
    if (value < limit) if is_least else (value > limit):
        problem = f"{each.name}: {value:g}{unit}, as {entry.by} entered it"
        return Check(
            each.name, State.FAIL, value, each.unit, allowed, problem, f"wait for better weather; {TO_DO}"
        )
    return Check(each.name, State.PASS, value, each.unit, allowed)
