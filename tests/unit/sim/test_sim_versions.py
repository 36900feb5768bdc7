"""Versions that fake vehicles can have: parameters by the names and units of each."""

from __future__ import annotations

import pytest

from gcs.sim.autopilots.ardupilot.parameters import Parameters as ArduParameters
from gcs.sim.vehicle import versions
from gcs.sim.vehicle.parameters import REAL32, Columns, ParameterError, ParameterList, Table
from gcs.sim.vehicle.px4 import Parameters as Px4Parameters
from gcs.sim.vehicle.versions import VersionError

PX4 = ("1.14", "1.15", "1.16", "1.17", "1.18")
COPTER = ("4.0", "4.1", "4.2", "4.3", "4.4", "4.5", "4.6", "4.7")


def listed(autopilot: str, version: str = "", *, as_delivered: bool = False) -> ParameterList:
    return versions.find(autopilot, version, as_delivered=as_delivered).parameters


def test_these_versions_can_be_chosen() -> None:
    assert (versions.names("px4"), versions.names("ardupilot")) == (PX4, COPTER)


@pytest.mark.parametrize(
    ("autopilot", "version", "number"),
    [
        ("px4", "", 0x011001FF),
        ("px4", "1.14", 0x010E04FF),
        ("px4", "1.18", 0x01120080),
        ("ardupilot", "", 0x04010000),
        ("ardupilot", "4.5", 0x040507FF),
        ("ardupilot", "4.7", 0x040700FF),
    ],
)
def test_the_version_number_has_the_release_type(autopilot: str, version: str, number: int) -> None:
    assert versions.find(autopilot, version).flight_sw_version == number


def test_an_unknown_version_is_refused_with_those_there_are() -> None:
    with pytest.raises(VersionError, match=r"PX4 v1\.19 is not known; there are 1\.14, 1\.15, .*1\.18"):
        versions.find("px4", "1.19")
    with pytest.raises(VersionError, match=r"'5' is not known; there are PX4 v1\.14.*; ArduCopter 4\.0"):
        versions.part_for("px4", "1.16,5")


def test_a_mixed_fleet_has_a_version_of_each_kind() -> None:
    assert [versions.part_for(kind, "1.16,4.5") for kind in ("px4", "ardupilot")] == ["1.16", "4.5"]
    assert [versions.part_for(kind, "4.7") for kind in ("px4", "ardupilot")] == ["", "4.7"]
    with pytest.raises(VersionError, match="one of ArduCopter is possible"):
        versions.part_for("ardupilot", "4.5, 4.6")


def test_px4_1_16_is_the_recorded_one() -> None:
    assert listed("px4", "1.16").listed == listed("px4").listed


@pytest.mark.parametrize("version", PX4)
def test_px4_simulator_and_firmware_differ_in_their_defaults(version: str) -> None:
    simulated, delivered = Table(listed("px4", version)), Table(listed("px4", version, as_delivered=True))
    assert delivered["COM_LOW_BAT_ACT"] == 0, "a warning only"
    assert simulated["COM_LOW_BAT_ACT"] == (2 if version in {"1.14", "1.15"} else 3)
    assert (simulated["COM_RC_IN_MODE"], delivered["COM_RC_IN_MODE"]) == (1, 3)


def test_px4_1_18_has_another_parameter_for_the_sticks() -> None:
    table = Px4Parameters(listed=listed("px4", "1.18"))
    assert "COM_RC_OVERRIDE" not in table.listed
    assert (table.own("MAN_OVERRIDE_SPD"), table.listed.kind("MAN_OVERRIDE_SPD")) == (1.0, REAL32)
    assert table["COM_RC_OVERRIDE"] == 3, "auto modes and OFFBOARD alike"
    table.set("MAN_OVERRIDE_SPD", -1.0)
    assert table["COM_RC_OVERRIDE"] == 0


def test_copter_4_7_has_new_names_and_units() -> None:
    old, new = (
        ArduParameters(listed=listed("ardupilot", "4.6")),
        ArduParameters(listed=listed("ardupilot", "4.7")),
    )
    for recorded, renamed in new.listed.renamed.items():
        assert recorded not in new.listed
        assert renamed.name in new.listed
        assert renamed.name not in old.listed or renamed.name == recorded
        assert new[recorded] == pytest.approx(old[recorded]), recorded
    assert (new.own("WP_ACC"), new["WPNAV_ACCEL"]) == (2.5, 250.0)
    assert (new.own("RTL_ALT_M"), new.own("ATC_ANGLE_MAX"), new.own("ARMING_SKIPCHK")) == (15.0, 30.0, 0)


@pytest.mark.parametrize(
    ("name", "value", "recorded", "reads"),
    [
        ("WP_ACC", 4.0, "WPNAV_ACCEL", 400.0),
        ("ARMING_SKIPCHK", -1, "ARMING_CHECK", 0),
        ("MAV_OPTIONS", 1, "SYSID_ENFORCE", 1),
        ("MAV_GCS_SYSID", 245, "SYSID_MYGCS", 245),
    ],
)
def test_the_model_follows_a_renamed_parameter(name: str, value: float, recorded: str, reads: float) -> None:
    table = ArduParameters(listed=listed("ardupilot", "4.7"))
    columns = Columns([table])
    before = float(columns[recorded][0])
    assert table.assign(name, value)
    assert [table[recorded], float(columns[recorded][0])] == pytest.approx([reads, reads])
    assert before != columns[recorded][0]


def test_a_recorded_name_sets_the_renamed_parameter() -> None:
    table = ArduParameters({"RTL_ALT": 3400, "ARMING_CHECK": 0}, listed("ardupilot", "4.7"))
    assert (table.own("RTL_ALT_M"), table.own("ARMING_SKIPCHK")) == (34.0, -1)
    assert not table.assign("RTL_ALT", 1500), "PARAM_SET knows the version's own names only"


def test_what_a_version_lacks_cannot_be_set() -> None:
    table = ArduParameters(listed=listed("ardupilot", "4.0"))
    with pytest.raises(ParameterError, match=r"GUID_TIMEOUT: ArduCopter 4\.0\.7 has no such parameter"):
        table.set("GUID_TIMEOUT", 1.0)
    assert (table["GUID_TIMEOUT"], table["FS_GCS_TIMEOUT"]) == (3.0, 5.0), "fixed in its code"


@pytest.mark.parametrize("version", COPTER)
def test_new_parameters_of_copter_begin_with_their_release(version: str) -> None:
    since = {"GUID_TIMEOUT": "4.1", "FS_DR_ENABLE": "4.3", "FENCE_OPTIONS": "4.6", "MAV_OPTIONS": "4.7"}
    assert {name for name in since if name in listed("ardupilot", version)} == {
        name for name, first in since.items() if version >= first
    }
