"""All requirements, in each supported version, compared with the published list of its parameters."""

import pytest

from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings
from gcs.links import ParameterValue
from gcs.links.autopilots import AUTOPILOTS
from gcs.links.autopilots.versions import Release
from gcs.preflight.autopilots import REQUIREMENTS
from gcs.preflight.parameters import broken, remaining_risks
from gcs.preflight.requirement import Equipment, Requirement
from tests.support.published import as_shipped, published

STATION, RETURNS_M = 245, 34.0
ALL = [(name, str(release)) for name, profile in AUTOPILOTS.items() for release in profile.versions.versions]
NEW_NAMES_OF_4_7 = 14


def needed(name: str, release: str, *, polygons: bool = False, **operation: object) -> list[Requirement]:
    settings = OperationSettings.model_validate(operation)
    equipment = Equipment(polygons, remote_id=polygons)
    written = REQUIREMENTS[name](settings, ControlSettings(), RETURNS_M, STATION, equipment)
    table, possible = AUTOPILOTS[name].versions, (Release.parse(release),)
    made = (one.of_versions(table, possible) for one in written)
    return [one for one in made if one is not None]


def applied(needed: list[Requirement]) -> dict[str, ParameterValue]:
    return {one.name: one.set_to for one in needed if not one.is_absent and not one.risk}


def test_each_supported_version_has_a_published_list() -> None:
    for name, profile in AUTOPILOTS.items():
        assert list(published(name)) == [str(release) for release in profile.versions.versions]


@pytest.mark.parametrize("release", [release for name, release in ALL if name == "ardupilot"])
def test_uploaded_polygons_need_their_bit_and_no_union(release: str) -> None:
    values = {
        polygons: {one.name: one for one in needed("ardupilot", release, polygons=polygons)}
        for polygons in (False, True)
    }
    assert [values[polygons]["FENCE_TYPE"].holds(3) for polygons in (False, True)] == [True, False]
    assert [values[polygons]["FENCE_TYPE"].holds(7) for polygons in (False, True)] == [True, True]
    if "FENCE_OPTIONS" in values[True]:
        of_any = [values[polygons]["FENCE_OPTIONS"].holds(2) for polygons in (False, True)]
        assert of_any == [True, False]


@pytest.mark.parametrize("action", ["hold", "descend", "land", "return"])
@pytest.mark.parametrize(("name", "release"), ALL)
def test_each_required_parameter_is_published_and_can_be_set(name: str, release: str, action: str) -> None:
    known = published(name)[release]
    for one in needed(name, release, setpoint_loss_action=action):
        if one.is_absent:
            assert one.name not in known, one.name
            continue
        found, value = known[one.name], one.set_to
        assert found.get("unit", "").replace("/s/s/s", "/s^3").replace("/s/s", "/s^2") == one.unit, one.name
        in_range = found.get("min", value) <= value <= found.get("max", value)
        assert value in found["values"] if "values" in found else in_range, one.name
        if "values" in found:  # an action that this version does not know would be another one
            assert set(one.choices) <= {*found["values"]}, one.name


@pytest.mark.parametrize(("name", "release"), ALL)
def test_vehicle_with_applied_values_passes(name: str, release: str) -> None:
    for action in ("hold", "descend", "land", "return"):
        for pilot in (True, False):
            these = needed(name, release, setpoint_loss_action=action, pilot_takes_over=pilot)
            assert broken(these, as_shipped(name, release) | applied(these)) == []


@pytest.mark.parametrize(("name", "release"), ALL)
def test_vehicle_as_shipped_is_refused_by_its_own_names(name: str, release: str) -> None:
    wrong = {one.name for one, _ in broken(needed(name, release), as_shipped(name, release))}
    assert wrong <= set(published(name)[release])
    expected = {
        "px4": {"COM_OBL_RC_ACT", "RTL_CONE_ANG", "COM_LOW_BAT_ACT", "COM_ARM_WO_GPS", "GF_MAX_HOR_DIST"},
        "ardupilot": {"RTL_CONE_SLOPE", "BATT_FS_LOW_ACT", "BATT_FS_CRT_ACT", "FENCE_ENABLE", "AVOID_ENABLE"},
    }
    assert expected[name] <= wrong


@pytest.mark.parametrize(("name", "release"), ALL)
def test_table_has_the_defaults_as_shipped(name: str, release: str) -> None:
    table, known = AUTOPILOTS[name].versions, published(name)[release]
    for newest in table.parameters:
        form = table.form(newest, Release.parse(release))
        if "default" not in known.get(form.name, {}):
            continue
        default = known[form.name]["default"]
        plain = next((new for new, old in form.values.items() if old == default), default / form.per_unit)
        defaults = table.parameters[newest].default
        *_, written = (value for first, value in defaults.items() if first <= Release.parse(release))
        assert written == plain, newest


def test_each_vehicle_of_4_7_has_metres_under_new_names() -> None:
    before, now = needed("ardupilot", "4.6"), needed("ardupilot", "4.7")
    of = {one.name: one for one in (*before, *now)}
    assert (of["RTL_ALT"].set_to, of["RTL_ALT"].desired) == (3400, "3350 to 3450 cm")
    assert (of["RTL_ALT_M"].set_to, of["RTL_ALT_M"].desired) == (34.0, "33.5 to 34.5 m")
    assert (of["WPNAV_ACCEL"].set_to, of["WP_ACC"].set_to) == (250.0, 2.5)
    assert (of["ARMING_CHECK"].choices, of["ARMING_SKIPCHK"].choices) == ((1,), (0,))
    gone = {one.name for one in before} - {one.name for one in now}
    assert len(gone) == NEW_NAMES_OF_4_7


def test_pilot_takes_over_by_sticks_in_every_version() -> None:
    names = [{one.name for one in needed("px4", release)} for _, release in ALL[:5]]
    assert ["COM_RC_OVERRIDE" in each for each in names] == [True] * 4 + [False]
    assert ["MAN_OVERRIDE_SPD" in each for each in names] == [False] * 4 + [True]
    (one,) = (each for each in needed("px4", "1.18") if each.name == "MAN_OVERRIDE_SPD")
    assert [one.holds(value) for value in (-1.0, 0.0, 1.0)] == [False, False, True]


def test_descend_needs_nav_rcl_act_from_1_17_on() -> None:
    """Without a transmitter COM_OBL_RC_ACT 0 does what it says there, as shipped a return."""
    for release, is_needed in (("1.16", False), ("1.17", True), ("1.18", True)):
        these = needed("px4", release, setpoint_loss_action="descend")
        wrong = [one.name for one, _ in broken(these, as_shipped("px4", release) | {"COM_OBL_RC_ACT": 0})]
        assert ("NAV_RCL_ACT" in wrong) == is_needed
        assert "NAV_RCL_ACT" not in {one.name for one in needed("px4", release)}


def test_vertical_limits_are_those_of_the_version() -> None:
    def found(release: str) -> set[str]:
        return {"PILOT_ACCEL_Z", "WPNAV_ACCEL_Z", "WP_ACC_Z"} & {
            one.name for one in needed("ardupilot", release)
        }

    assert [found(each) for each in ("4.0", "4.5", "4.7")] == [
        {"PILOT_ACCEL_Z"},
        {"WPNAV_ACCEL_Z"},
        {"WP_ACC_Z"},
    ]


def test_brake_for_lost_heartbeats_counts_from_4_5_on() -> None:
    """Earlier versions take an unknown action for RTL."""
    for release, choices in (("4.4", (0,)), ("4.5", (0, 7))):
        (one,) = (each for each in needed("ardupilot", release) if each.name == "FS_GCS_ENABLE")
        assert one.choices == choices


def test_critical_battery_without_a_threshold_is_a_named_risk() -> None:
    these, values = needed("ardupilot", "4.7"), as_shipped("ardupilot", "4.7")
    (risk,) = remaining_risks(these, values | applied(these))
    assert risk.startswith("BATT_CRT_VOLT and BATT_CRT_MAH are 0, so its action for a critical battery")
    for name in ("BATT_CRT_VOLT", "BATT_CRT_MAH"):
        assert remaining_risks(these, values | applied(these) | {name: 400.0}) == []
