"""Fake vehicles of one version: what they report, answer and fly."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import common

from gcs.sim.mixed import MixedFleet
from gcs.sim.settings import Settings
from gcs.sim.vehicle import versions
from tests.support.ardu_bench import ArduBench
from tests.support.sim_bench import ACCEPTED, UNSUPPORTED, Bench

VERSION = 148


def reported(bench: Bench) -> list[int]:
    return [message.flight_sw_version for message in bench.all("AUTOPILOT_VERSION")]


@pytest.mark.parametrize("version", versions.names("px4"))
def test_px4_reports_its_version(version: str) -> None:
    bench = Bench(version=version).run(0.1)
    assert bench.command(512, VERSION) == [ACCEPTED]
    assert bench.command(520, 1) == [UNSUPPORTED if version == "1.18" else ACCEPTED]
    assert set(reported(bench)) == {versions.find("px4", version).flight_sw_version}


@pytest.mark.parametrize("version", versions.names("ardupilot"))
def test_copter_reports_its_version(version: str) -> None:
    bench = ArduBench(version=version).run(0.1)
    assert [bench.command(512, VERSION), bench.command(520, 1)] == [[ACCEPTED], [ACCEPTED]]
    assert reported(bench) == 2 * [versions.find("ardupilot", version).flight_sw_version]


@pytest.mark.parametrize(
    ("version", "there", "missing"),
    [("4.6", "RTL_ALT", "RTL_ALT_M"), ("4.7", "RTL_ALT_M", "RTL_ALT"), ("4.0", "RTL_ALT", "GUID_TIMEOUT")],
)
def test_names_of_other_versions_have_no_answer(version: str, there: str, missing: str) -> None:
    bench = ArduBench(version=version).run(0.1)
    for name in (there, missing):
        bench.send(common.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
        bench.send(common.MAVLink_param_set_message(1, 1, name.encode(), 30.0, 9))
    assert {value.param_id for value in bench.run(0.2).all("PARAM_VALUE")} == {there}


def test_a_mixed_fleet_has_a_version_of_each_kind() -> None:
    settings = Settings(autopilot="mixed", count=2, version="1.14,4.7", parameters={"WPNAV_ACCEL": 400.0})
    px4, copter = MixedFleet(settings, start_s=0.0).autopilots
    assert "COM_POS_FS_DELAY" in px4.parameters.listed
    assert copter.parameters.own("WP_ACC") == 4.0
