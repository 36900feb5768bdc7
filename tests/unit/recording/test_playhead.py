"""The playhead: the time in the record that a replay shows."""

from math import inf, nan

import pytest

from gcs.model.errors import InvalidError, RefusedError
from gcs.recording.replay.service import Playhead


def test_moves_at_its_speed_unless_paused_and_stops_at_the_end() -> None:
    head = Playhead(60.0, 2.0, now_s=100.0)
    assert (head.position_s(100.0), head.position_s(110.0), head.position_s(200.0)) == (0.0, 20.0, 60.0)
    assert head.left_s(30.0, 110.0) == 5.0
    head.change(110.0, paused=True)
    assert head.position_s(150.0) == 20.0
    assert head.left_s(30.0, 150.0) == inf
    assert head.left_s(10.0, 150.0) == -5.0
    head.change(150.0, paused=False, speed=10.0)
    assert head.position_s(151.0) == 30.0
    head.change(151.0, position_s=5.0)
    assert head.position_s(152.0) == 15.0


@pytest.mark.parametrize("position_s", [-0.1, 60.1, nan, inf])
def test_time_outside_the_record_is_refused_with_its_range(position_s: float) -> None:
    head = Playhead(60.0, 1.0, now_s=0.0)
    with pytest.raises(InvalidError, match=r"position_s = .*: from 0 to 60.00, its duration"):
        head.change(1.0, paused=True, speed=3.0, position_s=position_s)
    assert (head.paused, head.speed, head.position_s(2.0)) == (False, 1.0, 2.0)


@pytest.mark.parametrize("speed", [0.0, -1.0, 100.5, nan, inf])
def test_invalid_speed_is_refused(speed: float) -> None:
    with pytest.raises(InvalidError, match="speed"):
        Playhead(60.0, speed, now_s=0.0)
    head = Playhead(60.0, 1.0, now_s=0.0)
    with pytest.raises(InvalidError, match="above 0, at most 100"):
        head.change(1.0, speed=speed)


def test_playback_cannot_resume_after_the_end() -> None:
    head = Playhead(60.0, 1.0, now_s=0.0)
    head.change(70.0, paused=True)
    with pytest.raises(RefusedError, match="the record has ended: give position_s"):
        head.change(71.0, paused=False)
    head.change(71.0, paused=False, position_s=0.0)
    assert head.position_s(72.0) == 1.0
