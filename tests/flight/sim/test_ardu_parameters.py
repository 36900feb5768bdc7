"""ArduPilot's parameter protocol: real numbers, answers by name without an index (habits 8, 58, 59)."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from gcs.sim.autopilots.ardupilot.parameters import defaults
from gcs.sim.fleet import STEP_S
from tests.support.ardu_bench import ArduBench, grounded

INT8, INT16, REAL32, NO_INDEX = 2, 4, 9, 65535


def set_parameter(bench: ArduBench, name: str, value: float, kind: int = REAL32) -> list[Any]:
    before = bench.count("PARAM_VALUE")
    bench.send(common.MAVLink_param_set_message(1, 1, name.encode(), value, kind))
    return bench.run(0.1).all("PARAM_VALUE")[before:]


def test_all_parameters_are_listed_as_real_numbers() -> None:
    bench = grounded(step_s=STEP_S)
    bench.send(common.MAVLink_param_request_list_message(1, 1))
    bench.run(3.0)
    values = bench.all("PARAM_VALUE")
    assert [value.param_id for value in values] == list(defaults())
    assert [value.param_index for value in values] == list(range(1131))
    assert {value.param_count for value in values} == {1131}
    by_name = {value.param_id: value for value in values}
    station = by_name["SYSID_MYGCS"]
    assert (station.param_type, station.param_value) == (INT16, 255.0)
    for name, default in defaults().items():
        assert by_name[name].param_value == pytest.approx(default, rel=1e-6), name


def test_the_list_is_there_within_a_second_and_has_no_hash() -> None:
    """Habit 8: PX4's _HASH_CHECK does not exist, and none is needed."""
    bench = grounded(step_s=STEP_S)
    bench.send(common.MAVLink_param_request_list_message(1, 1))
    assert bench.until(lambda: bench.count("PARAM_VALUE") == len(defaults()), 2.0) < 1.0
    bench.send(common.MAVLink_param_request_read_message(1, 1, b"_HASH_CHECK", -1))
    assert bench.run(0.5).count("PARAM_VALUE") == len(defaults())


def test_the_list_begins_with_the_banner() -> None:
    bench = grounded()
    bench.send(common.MAVLink_param_request_list_message(1, 1))
    assert bench.texts[-3:] == [
        "ArduCopter V4.1.0-dev (01bdf537)",
        "3d1219c7c4c5404aaa1f6d2a48adfda4",
        "Frame: QUAD",
    ]


@pytest.mark.parametrize("kind", [REAL32, INT8])
def test_the_type_of_param_set_does_not_matter(kind: int) -> None:
    (answer,) = set_parameter(grounded(), "FENCE_ACTION", 4.0, kind)
    assert (answer.param_value, answer.param_type, answer.param_index) == (4.0, INT8, NO_INDEX)


def test_the_answer_has_what_was_kept_not_what_was_sent() -> None:
    bench = grounded()
    for sent, kept in [(2.7, 2.0), (300.0, 127.0), (5.605193857299268e-45, 0.0), (1.0, 1.0), (1.0, 1.0)]:
        (answer,) = set_parameter(bench, "FENCE_ACTION", sent)
        assert answer.param_value == kept


def test_unknown_names_and_nan_have_no_answer() -> None:
    bench = grounded()
    assert set_parameter(bench, "NO_SUCH", 1.0) == []
    assert set_parameter(bench, "FENCE_RADIUS", float("nan")) == []
    for name, place in [(b"GUID_TIMEOUT", -1), (b"", 1131)]:
        bench.send(common.MAVLink_param_request_read_message(1, 1, name, place))
    assert bench.run(0.2).count("PARAM_VALUE") == 0


def test_read_by_name_has_no_index_and_by_index_has_one() -> None:
    bench = grounded()
    bench.send(common.MAVLink_param_request_read_message(1, 1, b"WPNAV_ACCEL", -1))
    bench.send(common.MAVLink_param_request_read_message(1, 1, b"", 1))
    by_name, by_index = bench.run(0.1).all("PARAM_VALUE")
    assert (by_name.param_id, by_name.param_value, by_name.param_index) == ("WPNAV_ACCEL", 100.0, NO_INDEX)
    assert (by_index.param_id, by_index.param_value, by_index.param_index) == ("SYSID_THISMAV", 1.0, 1)


def test_each_vehicle_has_its_own_sysid() -> None:
    bench = ArduBench(count=3)
    ids = [vehicle.parameters["SYSID_THISMAV"] for vehicle in bench.fleet.autopilots]
    assert ids == [1, 2, 3]
