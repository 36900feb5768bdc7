"""Which of the datagrams that MAVSDK wrote are setpoints, and which of those may leave."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from gcs.mavlink.setpoints import NO_ROW, SETPOINT_FRAME, are_setpoints, awaited_setpoints

ROOM, LONGEST = 16, 300

ROW_OF = np.full(256, NO_ROW, np.int64)
ROW_OF[[7, 9, 250]] = 0, 1, 2

VELOCITY_M_S = np.array([[1.0, -2.0, 0.5], [0.0, 0.0, 0.0], [3.0, 0.1, -0.1]])
BITS = VELOCITY_M_S.astype(np.float32).view(np.uint32)
ALL = np.ones(3, bool)


def setpoint(system_id: int, velocity_m_s: np.ndarray) -> bytes:
    """A frame as MAVSDK writes it."""
    mavlink = dialect.MAVLink(None, srcSystem=245, srcComponent=190)
    x_m_s, y_m_s, z_m_s = velocity_m_s.tolist()
    position, acceleration = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    target = (system_id, 1, dialect.MAV_FRAME_LOCAL_NED, 0x0DC7)
    stated = (0, *target, *position, x_m_s, y_m_s, z_m_s, *acceleration, 1.5, 0.0)
    packed: bytes = dialect.MAVLink_set_position_target_local_ned_message(*stated).pack(mavlink)
    return packed


def written(datagrams: list[bytes]) -> tuple[np.ndarray, np.ndarray]:
    """As they lie in a batch, whose room was used before."""
    data = np.full((ROOM, LONGEST), 0xFD, np.uint8)
    for at, datagram in enumerate(datagrams):
        data[at, : len(datagram)] = np.frombuffer(datagram, np.uint8)
    return data, np.array([*map(len, datagrams), *[0] * (ROOM - len(datagrams))])


def leaving(datagrams: list[bytes], awaited: np.ndarray = ALL) -> list[tuple[int, int]]:
    """(datagram, row) of those that may leave."""
    data, length = written(datagrams)
    found = are_setpoints(data, length, len(datagrams))
    places, rows = awaited_setpoints(data, found, ROW_OF, awaited, BITS)
    return list(zip(places.tolist(), rows.tolist(), strict=True))


def test_each_expected_setpoint_leaves_once_the_last_of_equals() -> None:
    first, second, third = (
        setpoint(system_id, VELOCITY_M_S[row]) for row, system_id in enumerate((7, 9, 250))
    )
    assert leaving([third, first, third, second]) == [(2, 2), (1, 0), (3, 1)]


@pytest.mark.parametrize(
    "datagram",
    [
        pytest.param(setpoint(7, VELOCITY_M_S[2]), id="what another was told"),
        pytest.param(setpoint(7, np.nextafter(VELOCITY_M_S[0], 9.0, dtype=np.float32)), id="nearly that"),
        pytest.param(setpoint(9, -VELOCITY_M_S[1]), id="minus zero, which the flight did not request"),
        pytest.param(setpoint(8, VELOCITY_M_S[0]), id="to somebody who is not ours"),
    ],
)
def test_unexpected_setpoint_does_not_leave(datagram: bytes) -> None:
    assert leaving([datagram]) == []


def test_nothing_leaves_to_a_vehicle_without_expected_setpoint() -> None:
    datagrams = [setpoint(7, VELOCITY_M_S[0]), setpoint(9, VELOCITY_M_S[1])]
    assert leaving(datagrams, np.array([False, True, True])) == [(1, 1)]


@given(st.lists(st.one_of(st.binary(max_size=LONGEST), st.just(setpoint(7, VELOCITY_M_S[0]))), max_size=ROOM))
def test_setpoint_is_exactly_one_whole_unsigned_frame(
    datagrams: list[bytes],
) -> None:
    data, length = written(datagrams)
    known = [each[:3] == bytes([0xFD, SETPOINT_FRAME.itemsize - 12, 0]) for each in datagrams]
    are = [
        is_begun and len(each) == SETPOINT_FRAME.itemsize and each[7:10] == bytes([84, 0, 0])
        for is_begun, each in zip(known, datagrams, strict=True)
    ]
    assert are_setpoints(data, length, len(datagrams)).tolist() == are


@pytest.mark.parametrize("cut", [1, 12, 40, SETPOINT_FRAME.itemsize - 1])
def test_partial_and_double_setpoints_are_rejected(cut: int) -> None:
    whole = setpoint(7, VELOCITY_M_S[0])
    assert leaving([whole[:cut], whole + whole, whole]) == [(2, 0)]
