"""Every failsafe and refusal text that PX4 1.14 to 1.18 and ArduCopter 4.0 to 4.7 publish has its meaning."""

import re

import pytest

from gcs.failsafe.autopilots.texts import ANY, ARDUPILOT, PX4, TEXTS, Meaning, meaning_of
from gcs.links.autopilots import AUTOPILOTS

M = Meaning

PX4_ALL = ("1.14", "1.15", "1.16", "1.17", "1.18")
COPTER_ALL = ("4.0", "4.1", "4.2", "4.3", "4.4", "4.5", "4.6", "4.7")

PUBLISHED = (
    (PX4, ("1.14",), "Failsafe activated, entering Hold for 5 seconds", M.HOLDS_FIRST),
    (PX4, PX4_ALL[1:], "Failsafe activated: entering Hold for 5 seconds", M.HOLDS_FIRST),
    (PX4, PX4_ALL, "Failsafe activated", M.UNSAID),
    (PX4, ("1.14",), "Preflight Fail: Geofence violation", M.REFUSED),
    (PX4, ("1.14",), "Maximum distance from home reached (60)", M.GEOFENCE),
    (PX4, ("1.14",), "Maximum altitude above home reached (60)", M.GEOFENCE),
    (PX4, ("1.15",), "Geofence violation: exceeding maximum distance to Home", M.GEOFENCE),
    (PX4, ("1.15",), "Geofence violation: exceeding maximum altitude above Home", M.GEOFENCE),
    (PX4, ("1.15",), "Geofence violation: approaching or outside geofence", M.GEOFENCE),
    (PX4, PX4_ALL[2:], "Geofence: exceeding maximum distance to Home", M.GEOFENCE),
    (PX4, PX4_ALL[2:], "Geofence: exceeding maximum altitude above Home", M.GEOFENCE),
    (PX4, PX4_ALL[2:], "Geofence: approaching or outside geofence", M.GEOFENCE),
    (PX4, PX4_ALL[:3], "Preflight Fail: No connection to the ground control station", M.REFUSED),
    (PX4, PX4_ALL[3:], "Preflight Fail: No connection to the GCS", M.REFUSED),
    (PX4, PX4_ALL[:3], "No connection to the ground control station", M.DATA_LINK_LOSS),
    (PX4, PX4_ALL[3:], "No connection to the GCS", M.DATA_LINK_LOSS),
    (PX4, PX4_ALL, "Connection to ground station lost", M.DATA_LINK_LOSS),
    (PX4, PX4_ALL, "GCS connection lost", M.DATA_LINK_LOSS),
    (PX4, PX4_ALL, "Connection to ground control station regained", M.OVER),
    (PX4, PX4_ALL, "Manual control lost", M.RC_LOSS),
    (PX4, PX4_ALL, "Manual control regained after 2.1 s", M.OVER),
    (PX4, PX4_ALL, "Pilot took over using sticks", M.PILOT),
    (PX4, PX4_ALL, "Pilot took over position control using sticks", M.PILOT),
    (PX4, PX4_ALL, "Compass needs calibration - Land now!", M.LAND_NOW),
    (PX4, PX4_ALL, "Critical battery level!", M.CRITICAL_BATTERY),
    (PX4, PX4_ALL, "Emergency battery level", M.CRITICAL_BATTERY),
    (PX4, PX4_ALL, "Low battery level", M.LOW_BATTERY),
    (PX4, PX4_ALL, "No valid local position estimate", M.POSITION_LOSS),
    (PX4, PX4_ALL, "Arming denied: Resolve system health failures first", M.REFUSED),
    (PX4, PX4_ALL, "Landing at current position", M.REFUSED),
    (PX4, PX4_ALL, "Flight termination active", M.TERMINATION),
    (ARDUPILOT, COPTER_ALL, "GCS Failsafe", M.DATA_LINK_LOSS),
    (ARDUPILOT, COPTER_ALL, "GCS Failsafe Cleared", M.LINK_BACK),
    (ARDUPILOT, COPTER_ALL, "Radio Failsafe", M.RC_LOSS),
    (ARDUPILOT, COPTER_ALL, "Radio Failsafe Cleared", M.OVER),
    (ARDUPILOT, COPTER_ALL, "Battery Failsafe", M.LOW_BATTERY),
    (ARDUPILOT, COPTER_ALL, "Battery 1 is low 10.81V used 2461 mAh", M.LOW_BATTERY),
    (ARDUPILOT, COPTER_ALL, "Battery 1 is critical 9.77V used 2557 mAh", M.CRITICAL_BATTERY),
    (ARDUPILOT, COPTER_ALL, "EKF variance", M.POSITION_LOSS),
    (ARDUPILOT, COPTER_ALL[1:], "EKF Failsafe: changed to LAND Mode", M.POSITION_LOSS),
    (ARDUPILOT, ("4.7",), "EKF Failsafe", M.POSITION_LOSS),
    (ARDUPILOT, COPTER_ALL, "EKF Failsafe Cleared", M.OVER),
    (ARDUPILOT, COPTER_ALL[3:], "GPS Glitch or Compass error", M.POSITION_LOSS),
    (ARDUPILOT, COPTER_ALL[3:], "Glitch cleared", M.OVER),
    (ARDUPILOT, COPTER_ALL[3:], "Dead Reckoning started", M.POSITION_LOSS),
    (ARDUPILOT, COPTER_ALL[3:], "Dead Reckoning timeout", M.POSITION_LOSS),
    (ARDUPILOT, COPTER_ALL[3:], "Dead Reckoning stopped", M.OVER),
    (ARDUPILOT, ("4.0",), "Mode change failed: GUIDED requires position", M.REFUSED),
    (ARDUPILOT, COPTER_ALL[1:], "Mode change to BRAKE failed: requires position", M.REFUSED),
    (ARDUPILOT, ("4.6", "4.7"), "Mode change to GUIDED failed: in fence recovery", M.REFUSED),
    (ARDUPILOT, ("4.7",), "Mode change to GUIDED failed: in RC failsafe", M.REFUSED),
    (ARDUPILOT, COPTER_ALL, "PreArm: Battery failsafe", M.REFUSED),
    (ARDUPILOT, COPTER_ALL, "Arm: Battery failsafe", M.REFUSED),
    (ARDUPILOT, COPTER_ALL[1:6], "Fence Breached", M.GEOFENCE),
    (ARDUPILOT, ("4.6", "4.7"), "Circle fence breached", M.GEOFENCE),
    (ARDUPILOT, ("4.6", "4.7"), "Max Alt and Circle fences breached", M.GEOFENCE),
    (ARDUPILOT, ("4.6", "4.7"), "Max Alt, Circle and Polygon fences breached", M.GEOFENCE),
    (ARDUPILOT, ("4.6", "4.7"), "Fence breach cleared", M.OVER),
    (ARDUPILOT, ("4.7",), "Circle fence in 5m", M.NOTHING),
    (ARDUPILOT, COPTER_ALL, "Crash: Disarming: AngErr=42>30, Accel=0.5<3.0", M.NOTHING),
)


def _number(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")))


@pytest.mark.parametrize(("autopilot", "versions", "text", "meaning"), PUBLISHED)
def test_published_text_has_its_meaning(
    autopilot: str, versions: tuple[str, ...], text: str, meaning: Meaning
) -> None:
    assert meaning_of(text) is meaning
    for version in versions:
        assert _of_version(text, autopilot, version) is meaning, "rows of other versions change nothing"


def _of_version(text: str, autopilot: str, version: str) -> Meaning:
    """What the rows of one version alone make of a text."""
    for row in TEXTS:
        first, _, last = row.versions.partition("-")
        sends = row.autopilot == ANY or (
            row.autopilot == autopilot and _number(first) <= _number(version) <= _number(last)
        )
        if sends and row.words.search(text.lower()):
            return row.meaning
    return Meaning.NOTHING


def test_rows_name_known_autopilots_and_versions_in_order() -> None:
    assert {row.autopilot for row in TEXTS} == {ANY, *AUTOPILOTS}
    for row in TEXTS:
        assert bool(row.versions) is (row.autopilot != ANY)
        assert not row.versions or re.fullmatch(r"\d+\.\d+-\d+\.\d+", row.versions)


def test_texts_of_no_failsafe_mean_nothing() -> None:
    for text in (
        "",
        "Takeoff detected",
        "Armed by external command",
        "EKF3 IMU0 is using GPS",
        "Frame: QUAD",
    ):
        assert meaning_of(text) is Meaning.NOTHING
