"""Remote ID: settings, the messages byte for byte, what is sent within a budget, what transponders report."""

from collections.abc import Mapping
from math import nan
from typing import Any, Final

import numpy as np
import pytest
from pydantic import ValidationError
from pymavlink.dialects.v20 import common

from gcs.flight.features.remote_id import swarm_area
from gcs.links.remote_id import messages
from gcs.links.remote_id.messages import Operator, SwarmArea
from gcs.links.remote_id.settings import BasicId, RemoteIdSettings
from gcs.links.remote_id.transponders import Transponders
from gcs.mavlink import codec
from gcs.mavlink.codec import Records
from gcs.model.state import Array

PLACE: Final = {"latitude_deg": 47.3977, "longitude_deg": 8.5456, "altitude_amsl_m": 488.0}
GIVEN: Final = {
    "operator": PLACE,
    "geoid_m": 47.5,
    "operator_id": "FIN87astrdge12k8",
    "self_id": "Light show",
}
OPERATOR: Final = Operator(47.3977, 8.5456, 535.5, live=False)
IDS: Final = np.array([1, 7, 200])
AREA: Final = SwarmArea(3, np.array([10.2, 20.0, 70_000.0]), 560.0, 530.0)
UNIX_S: Final = 1_790_000_000.9
NO_MAC: Final = [0] * 20


def settings(**change: Any) -> RemoteIdSettings:
    return RemoteIdSettings.model_validate(GIVEN | change)


def payloads(records: Records) -> list[bytes]:
    return [records[row : row + 1].tobytes() for row in range(len(records))]


def payload(message: Any) -> bytes:
    """As pymavlink writes it, with the zeros at its end that MAVLink 2 leaves out."""
    mav = common.MAVLink(None)
    frame = message.pack(mav)
    written: bytes = frame[10 : 10 + frame[1]]
    return written


def same(ours: bytes, message: Any) -> bool:
    theirs = payload(message)
    return ours.startswith(theirs) and not ours[len(theirs) :].strip(b"\0")


def test_system_has_the_bytes_of_pymavlink() -> None:
    made = messages.system_messages(IDS, np.arange(3), settings(), OPERATOR, AREA, UNIX_S)
    for row, (ours, radius_m) in enumerate(zip(payloads(made), (11, 20, 65535), strict=True)):
        fixed, undeclared = 2, 0
        about = fixed, undeclared, 473977000, 85456000, 3, radius_m, 560.0, 530.0, 0, 0, 535.5
        expected = common.MAVLink_open_drone_id_system_message(
            int(IDS[row]), 0, NO_MAC, *about, 1_790_000_000 - 1_546_300_800
        )
        assert same(ours, expected)


def test_system_in_the_european_union_has_category_and_class() -> None:
    european = settings(category="open", class_eu=3)
    live = Operator(-33.9, 151.2, nan, live=True)
    unknown = SwarmArea(1, np.zeros(1), nan, nan)
    (ours,) = payloads(messages.system_messages(IDS[:1], np.zeros(1, int), european, live, unknown, nan))
    place = -339000000, 1512000000
    expected = common.MAVLink_open_drone_id_system_message(
        1, 0, NO_MAC, 1, 1, *place, 1, 0, -1000.0, -1000.0, 1, 3, -1000.0, 0
    )
    assert same(ours, expected)


def test_an_operator_whose_place_is_unknown_is_sent_as_zero() -> None:
    nowhere = Operator(nan, nan, nan, live=True)
    (ours,) = payloads(messages.update_messages(IDS[2:], nowhere, UNIX_S))
    seconds = 1_790_000_000 - 1_546_300_800
    assert same(ours, common.MAVLink_open_drone_id_system_update_message(200, 0, 0, 0, -1000.0, seconds))


def test_texts_and_identities_have_the_bytes_of_pymavlink() -> None:
    (operator,) = payloads(messages.operator_id_message("FIN87astrdge12k8"))
    assert same(
        operator, common.MAVLink_open_drone_id_operator_id_message(0, 0, NO_MAC, 0, b"FIN87astrdge12k8")
    )
    (about,) = payloads(messages.self_id_message("Light show"))
    assert same(about, common.MAVLink_open_drone_id_self_id_message(0, 0, NO_MAC, 0, b"Light show"))
    identity = BasicId(kind="registration", id="N1234")
    (ours,) = payloads(messages.basic_id_message(7, identity))
    expected = common.MAVLink_open_drone_id_basic_id_message(7, 0, NO_MAC, 2, 2, b"N1234".ljust(20, b"\0"))
    assert same(ours, expected)


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"operator": None}, "operator or source"),
        ({"operator_id": "x" * 21}, "operator_id"),
        ({"self_id": "Lichtshow \u00fcber Bern"}, "self_id"),
        ({"operator": PLACE | {"latitude_deg": 91.0}}, "latitude_deg"),
        ({"operator": PLACE | {"altitude_amsl_m": nan}}, "altitude_amsl_m"),
        ({"class_eu": 8}, "class_eu"),
        ({"category": "c2"}, "category"),
        ({"basic_ids": {"d1": {"id": "with space"}}}, "basic_ids.d1.id"),
        ({"basic_ids": {"d1": {"id": ""}}}, "basic_ids.d1.id"),
    ],
)
def test_a_setting_that_cannot_be_sent_is_refused(change: Mapping[str, Any], place: str) -> None:
    with pytest.raises(ValidationError) as raised:
        settings(**change)
    problem = raised.value.errors()[0]
    assert place in ".".join(map(str, problem["loc"])) + problem["msg"]


def received(transponders: Transponders, message: Any, component: int = 236, time_s: float = 10.0) -> None:
    """Have a message of the first vehicle's transponder arrive."""
    mav = common.MAVLink(None, srcSystem=1, srcComponent=component)
    data = np.frombuffer(bytearray(message.pack(mav)), np.uint8)
    frames = codec.find(data, np.zeros(1, np.int64), np.array([len(data)])).frames
    transponders.listener.offer(data, frames, np.zeros(1, np.int64), np.full(1, time_s))


def beat(state: int = 3, kind: int = common.MAV_TYPE_ODID) -> Any:
    return common.MAVLink_heartbeat_message(kind, 8, 0, 0, state, 3)


def status(state: int = 0, error: bytes = b"") -> Any:
    return common.MAVLink_open_drone_id_arm_status_message(state, error)


def test_a_transponder_is_ready_once_it_reports_so() -> None:
    transponders = Transponders(2)
    assert transponders.problem(0, 10.0) == "its transponder was never received"
    received(transponders, beat())
    assert transponders.problem(0, 10.5) == ""
    received(transponders, status())
    assert transponders.problem(0, 10.5) == ""
    assert transponders.problem(1, 10.5) == "its transponder was never received"
    assert transponders.problem(0, 14.0) == "its transponder is silent for 4 s"


def test_a_transponder_says_why_it_is_not_ready() -> None:
    transponders = Transponders(1)
    received(transponders, status(1, b"SYS OP_LOC\n"))
    assert transponders.problem(0, 10.5) == 'its transponder is not ready: "SYS OP_LOC"'
    received(transponders, status(7, b"\xff" * 50))
    assert transponders.problem(0, 10.5).startswith("its transponder is not ready")
    received(transponders, status())
    received(transponders, beat(5))
    assert transponders.problem(0, 10.5) == "its transponder is in state 5, neither on standby nor active"


def test_a_heartbeat_of_something_else_is_no_transponder() -> None:
    transponders = Transponders(1)
    received(transponders, beat(kind=common.MAV_TYPE_CAMERA))
    assert transponders.problem(0, 10.0) == "its transponder was never received"


def radius_of(position_m: Array, group_m: Array) -> Array:
    """By all pairs."""
    apart_m: Array = np.linalg.norm(position_m[:, None, :2] - group_m[None, :, :2], axis=2).max(axis=1)
    return apart_m


@pytest.mark.parametrize("count", [1, 2, 64, 1000])
def test_the_area_holds_all_vehicles_and_little_more(count: int) -> None:
    generator = np.random.default_rng(count)
    for _ in range(20):
        place_m = generator.normal(0.0, generator.uniform(1.0, 500.0, 3), (count, 3))
        area = swarm_area(place_m, place_m, np.zeros(count), count, 535.5)
        true_m = radius_of(place_m, place_m)
        assert np.all(area.radius_m >= true_m - 1e-9)
        assert np.all(area.radius_m <= true_m * 1.0013 + 1e-9)
        assert area.count == count
        assert 0.0 <= area.ceiling_m - (535.5 - place_m[:, 2].min()) < 1.0
        assert 0.0 <= (535.5 - place_m[:, 2].max()) - area.floor_m < 1.0


def test_a_lost_vehicle_widens_by_what_it_may_have_moved() -> None:
    place_m = np.array([[0.0, 0.0, -10.0], [10.0, 0.0, -12.0], [nan, nan, nan]])
    area = swarm_area(place_m, place_m[:2], np.array([0.0, 25.0]), 3, 0.0)
    np.testing.assert_allclose(area.radius_m, [35.0, 25.0, 35.0])
    assert (area.ceiling_m, area.floor_m) == (12.0, 10.0)


def test_without_any_position_the_area_is_unknown() -> None:
    nowhere_m = np.full((2, 3), nan)
    area = swarm_area(nowhere_m, nowhere_m, np.zeros(2), 2, 0.0)
    assert area.count == 2
    assert np.isnan([area.ceiling_m, area.floor_m]).all()
