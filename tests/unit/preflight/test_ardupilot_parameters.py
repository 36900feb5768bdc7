"""What ArduCopter's parameters must be, compared with those that a real one had."""

import asyncio
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings
from gcs.flight.preflight.parameter_reader import read_needed
from gcs.links import ParameterValue
from gcs.links.autopilots import AUTOPILOTS
from gcs.links.autopilots.versions import Release, Version
from gcs.mavlink import codec
from gcs.mavlink.framing import PARAM_VALUE
from gcs.model.preflight_report import State
from gcs.preflight.autopilots.ardupilot import requirements
from gcs.preflight.parameters import (
    FleetRequirements,
    broken,
    parameter_checks,
    remaining_risks,
    requirements_of,
    settings_of,
)
from gcs.preflight.requirement import Requirement
from gcs.sim.autopilots.ardupilot.parameters import defaults
from gcs.testing.virtual_show import show_config
from tests.support.silent_link import SilentLink
from tests.support.tlog_files import frames

OPERATION, CONTROL, STATION = OperationSettings(), ControlSettings(), 245
VERSIONS = AUTOPILOTS["ardupilot"].versions


def made(operation: OperationSettings, version: Version | None) -> list[Requirement]:
    written = requirements(operation, CONTROL, 30.0, STATION)
    of_version = (one.of_versions(VERSIONS, VERSIONS.possible(version)) for one in written)
    return [one for one in of_version if one is not None]


NEEDED = made(OPERATION, VERSIONS.recorded.version)
"""Of the recorded version, which is between 4.0 and 4.1."""


def recorded() -> dict[str, ParameterValue]:
    """The values of a vehicle as delivered, of those that are required."""
    values: dict[str, ParameterValue] = {}
    for _, frame in frames("ardupilot/session.tlog.xz"):
        if frame.message_id == PARAM_VALUE:
            data = np.frombuffer(bytearray(frame.raw), np.uint8)
            found = codec.find(data, np.array([0]), np.array([len(data)])).frames
            (message,) = codec.decode(PARAM_VALUE, data, found)
            raw = np.array([message["param_value"]], np.float32)
            name, kind = codec.text(message["param_id"]), int(message["param_type"])
            values[name] = AUTOPILOTS["ardupilot"].decoded(raw, kind)
    return values


AS_DELIVERED = {**defaults(), **recorded()}
"""The whole list of the recorded version; the session has what was demanded when it was recorded."""
APPLIED = AS_DELIVERED | {one.name: one.set_to for one in NEEDED if one.name in AS_DELIVERED and not one.risk}


def needed(name: str, **operation: object) -> Requirement:
    """Of any version."""
    found = made(OperationSettings.model_validate(operation), None)
    return next(one for each in found for one in each.alternatives if one.name == name)


def test_every_required_parameter_exists_in_the_recorded_version() -> None:
    assert {each.name for each in NEEDED} - set(AS_DELIVERED) == VERSIONS.recorded.lacks
    assert all(each.may_lack for each in NEEDED if each.name not in AS_DELIVERED)
    for one in NEEDED:
        if one.name in AS_DELIVERED:
            assert type(one.set_to) is type(AS_DELIVERED[one.name]), one.name


def test_ardupilot_as_delivered_is_refused_and_applying_mends_it() -> None:
    wrong = {one.name for one, _ in broken(NEEDED, AS_DELIVERED)}
    assert {"SYSID_MYGCS", "WPNAV_ACCEL", "FENCE_ENABLE", "BATT_FS_LOW_ACT", "AVOID_ENABLE"} <= wrong
    assert broken(NEEDED, APPLIED) == []


@pytest.mark.parametrize(
    ("action", "good", "bad"), [("hold", 0, 1), ("return", 1, 0), ("land", 5, 0), ("descend", 5, 1)]
)
def test_heartbeat_failsafe_does_what_is_configured(action: str, good: int, bad: int) -> None:
    """Without setpoints alone it only hovers."""
    one = needed("FS_GCS_ENABLE", setpoint_loss_action=action)
    assert one.holds(good)
    assert not one.holds(bad)
    assert one.holds(one.set_to)


def test_its_heartbeat_failsafe_counts_our_heartbeats() -> None:
    one = needed("SYSID_MYGCS")
    assert (one.set_to, one.holds(245), one.holds(255)) == (245, True, False)
    assert needed("MAV_GCS_SYSID").holds(245)


def test_slow_braking_is_refused() -> None:
    """With 100 cm/s^2, its default, it needs 13 m from 5 m/s."""
    one = needed("WPNAV_ACCEL")
    assert not one.holds(100.0)
    assert one.holds(250.0)


def test_fleet_without_transmitters_has_no_radio_failsafe() -> None:
    assert needed("FS_THR_ENABLE", pilot_takes_over=False).choices == (0,)
    assert not needed("FS_THR_ENABLE", pilot_takes_over=True).holds(0)


def test_names_tell_which_version_a_vehicle_has() -> None:
    """Its version is not known."""
    anyone, newest = made(OPERATION, None), made(OPERATION, Version(Release(4, 7), 0, 255))
    values: dict[str, ParameterValue] = {one.name: one.set_to for one in newest}
    for these in (values, APPLIED):
        assert broken(anyone, these) == []
    (one,) = (wrong for wrong, _ in broken(anyone, values | {"ARMING_SKIPCHK": 1, "ARMING_CHECK": 1}))
    assert one.name == "ARMING_SKIPCHK"
    without = {name: value for name, value in values.items() if name != "RTL_ALT_M"}
    assert [(one.name, found) for one, found in broken(anyone, without)] == [("RTL_ALT_M", None)]


def test_what_a_version_lacks_is_named_and_no_failure() -> None:
    assert all(check.state is State.PASS for check in parameter_checks(NEEDED, APPLIED, None, ""))
    flies_on, critical = remaining_risks(NEEDED, APPLIED)
    assert flies_on.startswith("no GUID_TIMEOUT: it flies on for 3 s")
    assert critical.startswith("BATT_CRT_VOLT and BATT_CRT_MAH are 0")
    assert remaining_risks(NEEDED, APPLIED | {"GUID_TIMEOUT": 1.0, "BATT_CRT_VOLT": 10.0}) == []
    (wrong,) = broken(NEEDED, APPLIED | {"GUID_TIMEOUT": 3.0})
    assert wrong[0].name == "GUID_TIMEOUT"
    assert remaining_risks(made(OPERATION, Version(Release(4, 0), 7, 255)), APPLIED)[0] == flies_on


class Reading(SilentLink):
    """A link whose vehicles have these parameters."""

    def __init__(self, values: Mapping[str, ParameterValue]) -> None:
        super().__init__(("d1",))
        self.values, self.asked = values, list[str]()

    async def read_parameters(
        self, vehicle_id: str, names: Sequence[str], may_lack: Collection[str] = ()
    ) -> Mapping[str, ParameterValue]:
        self.asked += names
        assert {name for name in names if name not in self.values} <= set(may_lack)
        return {name: self.values[name] for name in names if name in self.values}


def test_names_of_other_versions_are_read_only_where_needed() -> None:
    link = Reading(AS_DELIVERED)
    values = asyncio.run(read_needed(link, "d1", NEEDED))
    assert values == {name: AS_DELIVERED[name] for name in link.asked if name in AS_DELIVERED}
    assert not {"MAV_GCS_SYSID", "ARMING_SKIPCHK", "RTL_ALT_M"} & set(link.asked)
    renamed = {name: value for name, value in AS_DELIVERED.items() if name != "SYSID_MYGCS"}
    link = Reading(renamed | {"MAV_GCS_SYSID": 255})
    read = asyncio.run(read_needed(link, "d1", made(OPERATION, None)))
    assert read["MAV_GCS_SYSID"] == 255
    assert {"RTL_ALT", "BATT_CRT_MAH"} <= set(read)


def mixed_config() -> Config:
    raw = show_config(2).model_dump()
    (link,) = raw["links"]
    vehicles = [each.model_dump() for each in show_config(2).fleet]
    link["vehicles"] = [vehicles[0], vehicles[1] | {"autopilot": "ardupilot"}]
    return Config.model_validate(raw)


def test_each_vehicle_of_a_mixed_fleet_has_its_own_requirements() -> None:
    config = mixed_config()
    names = [{one.name for one in each} for each in requirements_of(config).values()]
    assert "COM_OF_LOSS_T" in names[0] - names[1]
    assert "MAV_GCS_SYSID" in names[1] - names[0]
    version = Version.decoded(0x040703FF)
    of_version = {one.name for one in FleetRequirements(config).of(config.ids[1], version)}
    assert of_version == {one.name for one in made(config.operation, version)}


def test_simulated_vehicles_get_the_names_of_their_version() -> None:
    config = mixed_config()
    settings, later = settings_of(config), settings_of(config, "1.18,4.7")
    assert {"COM_RC_OVERRIDE", "SYSID_MYGCS", "WPNAV_ACCEL_Z", "PILOT_ACCEL_Z"} <= set(settings)
    assert not VERSIONS.recorded.lacks & set(settings)
    assert settings["SYSID_MYGCS"] == later["MAV_GCS_SYSID"] == config.links[0].station_id
    assert {"MAN_OVERRIDE_SPD", "MAV_GCS_SYSID", "WP_ACC_Z", "GUID_TIMEOUT"} <= set(later)
    assert not {"COM_RC_OVERRIDE", "SYSID_MYGCS", "PILOT_ACCEL_Z"} & set(later)


def test_loss_times_of_different_autopilots_leave_no_choice() -> None:
    """A vehicle that stops after 1 s is met by those that fly on for 3 s."""
    loss_s = mixed_config().operation.setpoint_loss_s
    mixed = requirements_of(mixed_config())
    (px4,) = [one for one in mixed["d1"] if one.name == "COM_OF_LOSS_T"]
    (copter,) = [one for one in mixed["d2"] if one.name == "GUID_TIMEOUT"]
    for one in (px4, copter):
        assert (one.desired, one.set_to) == (f"{loss_s:g} s", loss_s)
        assert one.holds(loss_s)
        assert not one.holds(loss_s - 0.5)
    (alone,) = [one for one in requirements_of(show_config(2))["d1"] if one.name == "COM_OF_LOSS_T"]
    assert alone.holds(loss_s - 0.5), "vehicles of one autopilot may all notice sooner"
