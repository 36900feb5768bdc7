"""The show's own time: pauses cost nothing, seeking is for the ground."""

import pytest

from gcs.model.errors import RefusedError, UnknownError
from gcs.shows import ShowClock
from tests.support.show_files import loaded

CUES = (
    {"cue": "in", "at_s": 5, "radius_m": 9},
    {"cue": "out", "at_s": 15, "radius_m": 8},
    {"cue": "end", "at_s": 25},
)


def test_clock_stands_before_the_show_and_while_paused() -> None:
    clock = ShowClock()
    assert clock.show_s(100.0) == 0.0
    clock = clock.run(100.0)
    assert clock.show_s(112.0) == 12.0
    clock = clock.stop(112.0)
    assert clock.show_s(500.0) == 12.0
    assert clock.run(600.0).show_s(603.0) == 15.0


def test_resuming_does_not_set_the_clock_back() -> None:
    clock = ShowClock().run(100.0)
    assert clock.run(110.0).show_s(115.0) == 15.0


def test_seek_goes_to_the_first_time_of_the_cue() -> None:
    timeline = loaded(*CUES, loops=[{"from_cue": "in", "to_cue": "end", "times": 3}]).timeline
    assert ShowClock().seek(timeline, "out", grounded=True) == ShowClock(15.0)
    assert ShowClock().seek(timeline, "end", grounded=True) == ShowClock(65.0)


def test_no_seek_in_the_air_or_to_an_unknown_cue() -> None:
    timeline = loaded(*CUES).timeline
    with pytest.raises(RefusedError, match="on the ground only"):
        ShowClock().seek(timeline, "out", grounded=False)
    with pytest.raises(UnknownError, match="begin, in, out, end"):
        ShowClock().seek(timeline, "finale", grounded=True)


def test_clock_ends_after_its_duration_but_not_while_stopped() -> None:
    timeline = loaded(*CUES).timeline
    clock = ShowClock().run(0.0)
    assert not clock.ended(timeline, 59.0)
    assert clock.ended(timeline, 60.0)
    assert not clock.stop(60.0).ended(timeline, 61.0)
