"""Fake vehicles of one version: what they report, answer and fly."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import common

from gcs.sim.mixed import MixedFleet
from gcs.sim.settings import Settings
from gcs.sim.vehicle import versions
from tests.support.ardu_bench import ArduBench, cruising
from tests.support.sim_bench import ACCEPTED, UNSUPPORTED, Bench

pytestmark = pytest.mark.soak

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


@pytest.mark.parametrize(
    ("version", "parameters", "beyond_m"),
    [
        ("4.0", {"PILOT_ACCEL_Z": 250, "WPNAV_ACCEL_Z": 100.0}, 1.3),
        ("4.5", {"PILOT_ACCEL_Z": 250, "WPNAV_ACCEL_Z": 100.0}, 3.4),
        ("4.5", {"PILOT_ACCEL_Z": 100, "WPNAV_ACCEL_Z": 250.0}, 2.1),
        ("4.7", {"PILOT_ACC_Z": 2.5, "WP_ACC_Z": 1.0}, 3.4),
    ],
)
def test_copter_stops_its_climb_as_its_release_does(
    version: str, parameters: dict[str, float], beyond_m: float
) -> None:
    """Flown on 4.5.5: from 2.4 m/s up 3.39 and 3.44 m as delivered, 2.10 m with 250 cm/s^2.

    The fake's thrust answers 0.1 s sooner, which makes 0.3 m.
    """
    bench = cruising(0.0, version=version, parameters=parameters)
    bench.stream(0.0, 0.0, -2.4)
    bench.run(6.0)
    assert bench.velocity[2] == pytest.approx(-2.4, abs=0.1)
    begin_m = bench.height_m
    bench.stream(0.0, 0.0, 0.0)
    assert max(bench.run(0.1).height_m for _ in range(70)) - begin_m == pytest.approx(beyond_m, abs=0.35)


def test_a_mixed_fleet_has_a_version_of_each_kind() -> None:
    settings = Settings(autopilot="mixed", count=2, version="1.14,4.7", parameters={"WPNAV_ACCEL": 400.0})
    px4, copter = MixedFleet(settings, start_s=0.0).autopilots
    assert "COM_POS_FS_DELAY" in px4.parameters.listed
    assert copter.parameters.own("WP_ACC") == 4.0
