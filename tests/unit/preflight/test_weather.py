"""The weather as it was entered, against limits: what is unknown, old or beyond is not go."""

from math import inf, nan

import pytest

from gcs.links.features import WeatherLimits
from gcs.model.errors import InvalidError
from gcs.model.preflight_report import State
from gcs.preflight.weather import check_entry, weather_checks
from gcs.service.go import WeatherEntry

LIMITS = WeatherLimits(wind_max_m_s=8, gust_max_m_s=11, visibility_min_m=3000, kp_max=4, age_max_s=1800)
GOOD = WeatherEntry(5.0, 8.0, 9000.0, 2.0, by="dana")


def failing(entry: WeatherEntry | None, age_s: float = 60.0) -> dict[str, str]:
    return {check.name: check.problem for check in weather_checks(LIMITS, entry, age_s) if not check.passes}


def test_weather_within_its_limits_passes() -> None:
    assert failing(GOOD) == {}
    assert failing(WeatherEntry(8.0, 11.0, 3000.0, 4.0, by="dana"), 1800.0) == {}
    assert [check.name for check in weather_checks(LIMITS, GOOD, 0.0)] == [
        "wind",
        "gusts",
        "visibility",
        "Kp",
    ]


@pytest.mark.parametrize(
    ("entry", "age_s", "says"),
    [
        (None, 0.0, {"wind": "wind: not known", "Kp": "Kp: not known"}),
        (WeatherEntry(5.0, None, 9000.0, 2.0, by="dana"), 0.0, {"gusts": "gusts: not known"}),
        (GOOD, 1801.0, {"wind": "wind: entered by dana 30 min ago"}),
        (GOOD, -1.0, {"wind": "wind: entered by dana at an unknown time"}),
        (GOOD, nan, {"wind": "wind: entered by dana at an unknown time"}),
        (WeatherEntry(8.1, 8.0, 9000.0, 2.0, by="dana"), 0.0, {"wind": "wind: 8.1 m/s, as dana entered it"}),
        (WeatherEntry(5.0, 8.0, 2999.0, 2.0, by="dana"), 0.0, {"visibility": "visibility: 2999 m, as dana"}),
        (WeatherEntry(5.0, 8.0, 9000.0, 5.0, by="dana"), 0.0, {"Kp": "Kp: 5, as dana entered it"}),
    ],
)
def test_unknown_old_or_bad_weather_is_not_go(
    entry: WeatherEntry | None, age_s: float, says: dict[str, str]
) -> None:
    problems = failing(entry, age_s)
    assert says.keys() <= problems.keys()
    assert all(problems[name].startswith(text) for name, text in says.items())
    checks = weather_checks(LIMITS, entry, age_s)
    assert all(check.to_do for check in checks if check.state is not State.PASS)


def test_without_limits_nothing_is_asked_for() -> None:
    assert [*weather_checks(WeatherLimits(), None, inf)] == []


@pytest.mark.parametrize(
    ("entry", "field"),
    [
        (WeatherEntry(), "weather"),
        (WeatherEntry(wind_m_s=-0.1), "wind_m_s"),
        (WeatherEntry(gust_m_s=nan), "gust_m_s"),
        (WeatherEntry(visibility_m=inf), "visibility_m"),
        (WeatherEntry(kp=9.1), "kp"),
    ],
)
def test_an_entry_that_no_instrument_shows_is_refused(entry: WeatherEntry, field: str) -> None:
    with pytest.raises(InvalidError) as refused:
        check_entry(entry)
    assert refused.value.field == field
