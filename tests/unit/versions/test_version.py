"""Versions as AUTOPILOT_VERSION reports them, and as which supported ones a vehicle is taken."""

import pytest

from gcs.links.autopilots import AUTOPILOTS
from gcs.links.autopilots.versions import Release, Version
from gcs.model.preflight_report import State
from gcs.preflight.versions import missing_to_do, version_checks, version_risks

PX4, COPTER = (AUTOPILOTS[name].versions for name in ("px4", "ardupilot"))


def made(text: str, kind: int = 255) -> Version:
    return Version(Release.parse(text), 0, kind)


@pytest.mark.parametrize(
    ("raw", "text", "is_released"),
    [
        (0x011001FF, "1.16.1", True),
        (0x04010000, "4.1.0-dev", False),
        (0x01120080, "1.18.0-beta", False),
        (0x040700C0, "4.7.0-rc", False),
        (0x040A02FF, "4.10.2", True),
        (0x01100107, "1.16.1-custom", False),
    ],
)
def test_version_is_decoded(raw: int, text: str, is_released: bool) -> None:
    version = Version.of(raw)
    assert version is not None
    assert (str(version), version.is_released) == (text, is_released)


def test_version_0_is_not_known() -> None:
    assert Version.of(0) is None


@pytest.mark.parametrize(
    ("version", "possible"),
    [
        (None, "1.14 1.15 1.16 1.17 1.18"),
        (made("1.16"), "1.16"),
        (made("1.17", 0), "1.16 1.17"),  # a development build may have any part of the change
        (made("1.14", 0), "1.14"),
        (made("1.19"), "1.18"),
        (made("1.19", 0), "1.18"),
        (made("1.13"), "1.14"),
    ],
)
def test_vehicle_is_taken_for_supported_versions(version: Version | None, possible: str) -> None:
    assert " ".join(map(str, PX4.possible(version))) == possible


def test_recorded_versions_are_those_of_the_fake_vehicles() -> None:
    assert [str(each.recorded.version) for each in (PX4, COPTER)] == ["1.16.1", "4.1.0-dev"]
    assert [str(each.recorded_or("1.18,4.5")) for each in (PX4, COPTER)] == ["1.18.0", "4.5.0"]
    assert str(COPTER.recorded_or("1.18")) == "4.1.0-dev"


def test_value_is_read_under_every_name() -> None:
    assert [COPTER.read("WP_ACC", values) for values in ({"WPNAV_ACCEL": 250.0}, {"WP_ACC": 2.5}, {})] == [
        2.5,
        2.5,
        None,
    ]
    assert COPTER.least_default("WP_ACC") == 1.0


def test_too_old_a_version_is_refused_in_words() -> None:
    (check,) = version_checks(PX4, made("1.13"))
    assert check.state is State.FAIL
    assert check.problem == "it has PX4 1.13.0, PX4 1.14 to 1.18 can be flown"
    assert check.to_do == "update its firmware"
    assert [check.state for check in version_checks(PX4, made("1.14"))] == [State.PASS]
    assert version_checks(COPTER, made("3.6"))[0].problem.startswith("it has ArduCopter 3.6.0")


def test_newer_version_is_named_with_what_is_not_known() -> None:
    (check,) = version_checks(PX4, made("1.19"))
    assert check.passes
    newer, polygons = version_risks(PX4, made("1.19"))
    assert newer.startswith("it has PX4 1.19.0, newer than what this station knows (PX4 1.14 to 1.18)")
    assert polygons.startswith("its RTL flies round polygon fences")
    to_do = "update the station, or fly PX4 1.14 to 1.18: PX4 1.19.0 is newer than what it knows"
    assert missing_to_do(PX4, made("1.19")) == to_do
    assert list(version_risks(PX4, made("1.18"))) == []


def test_version_that_is_not_reported_is_named() -> None:
    assert version_checks(PX4, None) == []
    (risk,) = version_risks(PX4, None)
    assert risk.startswith("its version is not known")
