"""Fleets in which PX4 and ArduPilot alternate, and faults of vehicles with ArduPilot."""

from __future__ import annotations

import json
from typing import Any

import pytest

from gcs.sim.autopilots.ardupilot.modes import Mode
from gcs.sim.faults.injector import FaultInjector
from gcs.sim.fleet import Fleet
from gcs.sim.ground_truth import sample
from gcs.sim.mixed import MixedFleet, fleet_of
from gcs.sim.protocol.frames import Codec
from gcs.sim.settings import Settings
from gcs.sim.vehicle.px4 import Quirks
from tests.support.ardu_bench import ArduBench, command, cruising, grounded, hovering
from tests.support.sim_bench import ACCEPTED, FAILED, UNSUPPORTED

pytestmark = pytest.mark.soak

PX4, ARDUPILOT = 12, 3


def mixed(count: int = 5, **settings: Any) -> MixedFleet:
    fleet = fleet_of(
        Settings(autopilot="mixed", count=count, noise_scale=0.0, **settings), start_s=100.0, step_s=0.02
    )
    assert isinstance(fleet, MixedFleet)
    return fleet


def beats(fleet: MixedFleet | Fleet, over_s: float = 3.0) -> dict[int, set[int]]:
    """Autopilots by row, of the heartbeats in some seconds."""
    seen: dict[int, set[int]] = {}
    for _ in range(round(over_s / fleet.step_s)):
        fleet.step()
        for row, frames in fleet.take_frames().items():
            kinds = [frame[10 + 5] for frame in frames if frame[0] == 0xFD and frame[7:10] == b"\0\0\0"]
            kinds += [frame[6 + 5] for frame in frames if frame[0] == 0xFE and frame[5] == 0]
            seen.setdefault(row, set()).update(kinds)
    return {row: kinds for row, kinds in seen.items() if kinds}


@pytest.mark.parametrize("first", [0, 3])
def test_autopilots_alternate_by_vehicle_index(first: int) -> None:
    found = beats(mixed(5, first=first))
    assert found == {row: {ARDUPILOT if (first + row) % 2 else PX4} for row in range(5)}


@pytest.mark.parametrize("count", [1, 2])
def test_a_mixed_fleet_may_be_small(count: int) -> None:
    assert sorted(beats(mixed(count))) == list(range(count))


def test_vehicles_of_a_mixed_fleet_stand_on_one_grid() -> None:
    settings: dict[str, Any] = {"spacing_m": 3.0, "grid_columns": 2, "grid_at_m": (10.0, 0.0)}
    of_one_kind = Fleet(Settings(count=5, **settings), start_s=0.0)
    assert mixed(5, **settings).position_m.tolist() == of_one_kind.bodies.position_m.tolist()


def test_ids_and_truth_are_in_the_order_of_the_vehicles() -> None:
    fleet = mixed(5, first=2, namespace_size=4)
    fleet.step()
    assert [vehicle.system_id for vehicle in fleet.autopilots] == [3, 4, 1, 2, 3]
    rows = sample(fleet, 0.0)["vehicles"]
    assert isinstance(rows, list)
    assert [row["vehicle"] for row in rows] == [3, 4, 5, 6, 7]
    assert [row["mode"] for row in rows] == ["HOLD", "STABILIZE", "HOLD", "STABILIZE", "HOLD"]


def test_a_parameter_goes_to_the_vehicles_that_have_it() -> None:
    fleet = mixed(4, parameters={"WPNAV_ACCEL": [1.0, 250.0, 3.0, 400.0], "COM_OF_LOSS_T": 5.0})
    assert [vehicle.parameters["WPNAV_ACCEL"] for vehicle in fleet.parts[1].autopilots] == [250.0, 400.0]
    assert fleet.parts[0].autopilots[0].parameters["COM_OF_LOSS_T"] == 5.0


def test_one_socket_reaches_both_kinds() -> None:
    fleet = mixed(4, quirks=Quirks().changed([("late-ready", False)]))
    circle = fleet.receiver.circle(range(4))
    for _ in range(60):
        fleet.step()
    mavlink = Codec()
    for target in (1, 2, 9):
        fleet.receiver.receive([(circle, mavlink.encode(command(400, 1, target=target), 245, 0))])
    assert [vehicle.commander.armed for vehicle in fleet.autopilots] == [True, True, False, False]
    assert fleet.receiver.receive([(circle, b"garbage")]) == [False]


def faulty(bench: Any, **fields: Any) -> dict[str, Any]:
    return dict(json.loads(FaultInjector(bench.fleet).obey(json.dumps({"vehicle": 1, **fields}))))


def test_faults_reach_the_vehicles_of_a_mixed_fleet() -> None:
    fleet = mixed(4)
    fault_injector = FaultInjector(fleet)
    for number in (2, 3):
        fault = {"vehicle": number, "fault": "fix", "type": "2d"}
        assert json.loads(fault_injector.obey(json.dumps(fault)))["ok"]
    assert [part.state.fix_type.tolist() for part in fleet.parts] == [[3, 2], [2, 6]]
    fault_injector.obey(json.dumps({"vehicles": "all", "fault": "none"}))
    assert [part.state.fix_type.tolist() for part in fleet.parts] == [[3, 3], [6, 6]]


def test_a_pilot_takes_over_by_the_switch_not_by_the_sticks() -> None:
    bench = cruising(3.0)
    fault_injector = FaultInjector(bench.fleet)
    by_sticks = {"vehicle": 1, "fault": "pilot", "by": "sticks"}
    assert json.loads(fault_injector.obey(json.dumps(by_sticks)))["unmoved"] == [1]
    fault_injector.obey(json.dumps({"vehicle": 1, "fault": "pilot", "north_m_s": 2.0}))
    bench.run(5.0)
    assert bench.custom_mode == Mode.LOITER
    assert bench.velocity == pytest.approx((2.0, 0.0, 0.0), abs=0.2)
    fault_injector.obey(json.dumps({"vehicle": 1, "fault": "none"}))
    assert bench.run(4.0).custom_mode == Mode.BRAKE
    assert bench.velocity == pytest.approx((0.0, 0.0, 0.0), abs=0.2)


def test_a_bad_fix_is_the_loss_of_gps() -> None:
    bench = hovering()
    faulty(bench, fault="fix", type="none")
    bench.run(9.0)
    assert bench.custom_mode == Mode.LAND


def test_an_unhealthy_sensor_refuses_arming() -> None:
    bench = grounded()
    faulty(bench, fault="sensor", which="gyro")
    assert bench.run(1.5).arm() == [FAILED]
    assert bench.texts[-1] == "PreArm: Gyros not healthy"


@pytest.mark.parametrize(("answer", "result"), [("accepted", ACCEPTED), ("rejected", UNSUPPORTED)])
def test_a_stuck_mode_answers_and_stays(answer: str, result: int) -> None:
    bench = hovering()
    faulty(bench, fault="stuck-mode", answer=answer)
    assert bench.order(Mode.LAND) == [result]
    assert bench.run(2.0).custom_mode == Mode.GUIDED


def test_a_reboot_in_the_air_lets_it_fall() -> None:
    bench = hovering()
    faulty(bench, fault="reboot", off_s=0.0)
    bench.run(4.0)
    assert bench.truth[2] == 0.0
    assert bench.custom_mode == Mode.STABILIZE


def test_a_position_that_jumps_is_flown_back() -> None:
    bench = hovering()
    bench.stream(0.0, 0.0, 0.0)
    bench.run(1.0)
    faulty(bench, fault="gps-jump", north_m=4.0)
    assert bench.run(0.3).last("LOCAL_POSITION_NED").x == pytest.approx(4.0, abs=1.0)
    assert bench.run(10.0).truth[0] == pytest.approx(-4.0, abs=0.3)


@pytest.mark.soak
def test_noise_and_wind_move_it_little() -> None:
    bench = hovering(noise_scale=0.25, wind_m_s=(0.0, 4.0, 0.0))
    bench.stream(0.0, 0.0, 0.0)
    bench.run(5.0)
    there = bench.truth
    assert bench.run(10.0).truth == pytest.approx(there, abs=0.6)
    assert bench.fleet.sensors.velocity_m_s[0] == pytest.approx((0.0, 0.0, 0.0), abs=0.3)


def flown(seed: int) -> list[float]:
    bench = ArduBench(noise_scale=1.0, seed=seed)
    bench.rise(3.0)
    return [*bench.truth, *[message.x for message in bench.all("LOCAL_POSITION_NED")]]


@pytest.mark.soak
def test_the_same_seed_flies_the_same_flight() -> None:
    assert flown(7) == flown(7)
    assert flown(7) != flown(8)
