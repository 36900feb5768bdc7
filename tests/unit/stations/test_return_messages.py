"""Paths of a collective return, as bytes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.bus import PAYLOAD_MAX
from gcs.model.errors import LinkError
from gcs.stations.return_messages import STEP_M, TOGETHER, ReturnMessage, in_parts


def paths(count: int, points: int = 300) -> ReturnMessage:
    rng = np.random.default_rng(count)
    corners_m = rng.uniform(-60.0, 60.0, (count, 2, 3))
    share = np.linspace(0.0, 1.0, points)[None, :, None]
    drawn_m = corners_m[:, :1] + share * (corners_m[:, 1:] - corners_m[:, :1])
    return ReturnMessage(
        7,
        np.arange(count),
        drawn_m,
        drawn_m + 0.5,
        corners_m[:, 1],
        np.full(count, 40.0),
        np.full(count, 60.0),
        np.arange(count) != 1,
    )


def test_paths_arrive_within_a_centimetre() -> None:
    sent = paths(40)
    parts = [ReturnMessage.decode(part.encode()) for part in in_parts(sent)]
    assert [len(part.rows) for part in parts] == [TOGETHER, TOGETHER, 8]
    assert {part.parts for part in parts} == {3}
    assert np.abs(np.concatenate([part.drawn_m for part in parts]) - sent.drawn_m).max() <= STEP_M
    assert np.abs(np.concatenate([part.path_m for part in parts]) - sent.path_m).max() <= STEP_M
    assert np.concatenate([part.planned for part in parts]).tolist() == sent.planned.tolist()
    assert np.concatenate([part.rows for part in parts]).tolist() == list(range(40))


def test_longest_paths_fit_into_one_message() -> None:
    assert max(len(part.encode()) for part in in_parts(paths(TOGETHER, 6000))) <= PAYLOAD_MAX


@given(st.binary(max_size=200))
def test_other_bytes_are_refused(payload: bytes) -> None:
    with pytest.raises(LinkError):
        ReturnMessage.decode(payload)


@given(st.integers(0, 5000), st.integers(0, 255))
def test_damaged_bytes_are_refused_or_finite(at: int, value: int) -> None:
    payload = bytearray(paths(3).encode())
    payload[at % len(payload)] = value
    try:
        received = ReturnMessage.decode(bytes(payload))
    except LinkError:
        return
    assert np.isfinite(received.drawn_m).all()
    assert np.isfinite(received.pad_m).all()
