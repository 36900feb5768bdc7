"""Requests between two stations: each is taken once, in order, whatever the bus loses."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.model.errors import LinkError
from gcs.stations.letters import AGAIN_S, EXPIRES_S, SIZE_MAX, WAITING_MAX, Letters


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=60, max_size=60))
def test_each_request_is_taken_once_and_in_order(arrives: list[tuple[bool, bool]]) -> None:
    one, other = Letters(11), Letters(22)
    taken: list[int] = []
    for number, (there, back) in enumerate([*arrives, *[(True, True)] * 60]):
        now_s = AGAIN_S * number
        if number < 20:
            one.post({"number": number}, now_s)
        sent, answer = one.payload(now_s), other.payload(now_s)
        if sent is not None and there:
            taken += [body["number"] for body in other.take(sent, now_s)]
        if answer is not None and back:
            one.take(answer, now_s)
    assert taken == sorted(set(taken))
    if all(there and back for there, back in arrives):
        assert taken == list(range(20))
    assert one.payload(1000.0) is None  # received, or expired


def test_request_that_is_not_received_expires() -> None:
    one = Letters(1)
    one.post({"stop": True}, 0.0)
    assert one.payload(0.0) is not None
    assert one.payload(EXPIRES_S + 0.1) is None


def test_restarted_station_takes_new_requests() -> None:
    one, other = Letters(1), Letters(2)
    for number in range(5):
        one.post({"number": number}, 0.0)
    assert len(other.take(one.payload(0.0) or b"", 0.0)) == 5
    again = Letters(3)  # the other station, begun anew
    one.take(other.payload(0.1) or b"", 0.1)
    one.post({"number": 5}, 0.2)
    assert again.take(one.payload(0.2) or b"", 0.2) == [{"number": 5}]
    new = Letters(4)  # now the first one
    new.post({"number": 0}, 0.3)
    assert again.take(new.payload(0.3) or b"", 0.3) == [{"number": 0}]


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"{}",
        b"[1]",
        b'{"session":1,"of":1,"received":1,"items":[[1]]}',
        b'{"session":1,"of":1,"received":1,"items":[[1,2]]}',
        b'{"session":1e999,"of":1,"received":1,"items":[]}',
        b"[" * 40_000,
        b" " * (SIZE_MAX + 1),
    ],
)
def test_other_bytes_are_refused(payload: bytes) -> None:
    with pytest.raises(LinkError):
        Letters(1).take(payload, 0.0)


def test_number_and_size_of_waiting_requests_are_bounded() -> None:
    one = Letters(1)
    with pytest.raises(LinkError, match="at most"):
        one.post({"text": "x" * SIZE_MAX}, 0.0)
    for _ in range(WAITING_MAX):
        one.post({"text": "x" * 1000}, 0.0)
    with pytest.raises(LinkError, match="not received yet"):
        one.post({}, 0.0)
    assert len(one.payload(0.0) or b"") <= SIZE_MAX
