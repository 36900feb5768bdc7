"""A show's clock follows a timecode that jitters, drifts, drops out, stops and jumps."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import takewhile

import numpy as np
import pytest

from gcs.model.state import Array
from gcs.shows.tempo import CHANGE_PER_S, Tempo, desired_rate
from gcs.shows.timecode import Chase, ChaseState, Rate, Reading
from gcs.shows.timecode.midi import MidiTimecode
from gcs.shows.timecode.smpte import Label
from tests.support.timecode import NAMED, Sent, full_frame, late, running

TICK_S = 0.05
START = Label(1, 0, 0, 0)


@dataclass
class Following:
    """A clock that follows messages, as the service's does; times of its own, from 0."""

    messages: list[tuple[float, bytes]]  # when each arrives
    midi: MidiTimecode = field(default_factory=MidiTimecode)
    chase: Chase = field(default_factory=lambda: Chase(freewheel_s=1.0, jump_max_s=5.0))
    tempo: Tempo = Tempo()
    start: Label = START  # counts as the show's beginning, whatever the rate is seen to be
    clock_s: float = np.nan  # timecode of the show
    rate: Rate | None = None
    at: list[tuple[float, float, float, ChaseState]] = field(
        default_factory=list
    )  # time, clock, tempo, state

    def run(self, seconds: float, begins_s: float) -> "Following":
        """Tick for so long; the show begins when the timecode has come to `begins_s`."""
        waiting = iter(sorted(self.messages, key=lambda one: one[0]))
        newest = next(waiting, None)
        for tick in range(int(seconds / TICK_S)):
            now_s = tick * TICK_S
            while newest is not None and newest[0] <= now_s:
                for reading in self.midi.take(newest[1]):
                    self.chase.take(reading, newest[0])
                newest = next(waiting, None)
            self._tick(now_s, begins_s)
        return self

    def _tick(self, now_s: float, begins_s: float) -> None:
        chase = self.chase
        follows = chase.runs(now_s)
        if self.rate is not None and chase.rate is not None:  # the show's own time stays
            self.clock_s += self.start.time_s(chase.rate) - self.start.time_s(self.rate)
        self.rate = chase.rate
        if np.isnan(self.clock_s):
            if follows and chase.time_s(now_s) >= begins_s:
                self.clock_s = chase.time_s(now_s)
        else:
            behind_s = chase.time_s(now_s) - self.clock_s - self.tempo.rate * TICK_S
            desired = desired_rate(behind_s, chase.slope(), 0.1) if follows else 0.0
            self.tempo = self.tempo.step(desired, TICK_S)
            self.clock_s += self.tempo.rate * TICK_S
        chase.show_s = self.clock_s
        self.at.append((now_s, self.clock_s, self.tempo.rate, chase.state(now_s)))

    @property
    def table(self) -> Array:
        """(k, 3) time, clock, tempo."""
        return np.array([row[:3] for row in self.at])


def arriving(
    until_s: float, rate: Rate, speed: float, delay_s: Callable[[], float], drop_outs: float = 0.0
) -> Iterator[tuple[float, bytes]]:
    """Messages of a timecode from START on, in order; of each ten seconds, `drop_outs` s of them are lost."""
    arrived_s = 0.0
    for sent in running(START, rate, speed):
        if sent.at_s > until_s:
            return
        if not 7.0 <= sent.at_s % 10.0 < 7.0 + drop_outs:
            arrived_s = max(arrived_s, sent.at_s + delay_s())
            yield arrived_s, sent.message


@pytest.mark.alternates(0)
@pytest.mark.parametrize("rate", NAMED)
@pytest.mark.parametrize("speed", [0.9985, 1.001])
def test_the_show_is_within_20_ms_of_a_bad_timecode(rate: Rate, speed: float) -> None:
    """0.1 % of drift, 5 ms of delays with a long tail, and 0.4 s in every ten lost."""
    messages = list(arriving(120.0, rate, speed, late(0.005, seed=rate.value), drop_outs=0.4))
    begin_s = START.time_s(rate)
    following = Following(messages).run(120.0, begin_s + 1.0)
    time_s, clock_s, _ = following.table.T
    true_s = begin_s + time_s * speed
    flown = time_s > 3.0
    off_s = np.abs(clock_s - true_s)[flown]
    assert np.percentile(off_s, 99) <= 0.020
    assert {row[3] for row in following.at if row[0] > 3.0} <= {ChaseState.RUNNING, ChaseState.DROPPED_OUT}
    assert (np.diff(clock_s[flown]) > 0.0).all()


def test_a_timecode_that_stops_freezes_the_show_and_takes_it_on() -> None:
    """The show runs on for the time in which it might be a drop-out, then comes to rest without a jump."""
    first = list(arriving(20.0, Rate.FPS_25, 1.0, late(0.002, 1)))
    stop_s, again_s = 20.0, 40.0
    second = [
        (at_s + again_s - stop_s, message)
        for at_s, message in arriving(60.0, Rate.FPS_25, 1.0, late(0.002, 2))
        if at_s >= stop_s
    ]
    following = Following([*first, *second]).run(75.0, START.time_s(Rate.FPS_25) + 1.0)
    time_s, clock_s, tempo = following.table.T
    stands = (time_s > stop_s + 3.0) & (time_s < again_s)
    assert tempo[stands].max() == 0.0
    past_s = clock_s[stands][0] - START.time_s(Rate.FPS_25) - stop_s
    assert past_s < 1.0 + 0.5 / CHANGE_PER_S + 0.1
    assert np.abs(np.diff(tempo)).max() <= CHANGE_PER_S * TICK_S + 1e-9
    caught_up = time_s > again_s + 10.0
    true_s = START.time_s(Rate.FPS_25) + time_s - (again_s - stop_s)
    assert np.abs(clock_s - true_s)[caught_up & (time_s < 74.0)].max() < 0.02


@pytest.mark.parametrize("jump_s", [2.0, -2.0])
def test_a_small_jump_is_slewed_never_jumped(jump_s: float) -> None:
    first = list(arriving(20.0, Rate.FPS_30, 1.0, late(0.002, 1)))
    second = [
        (at_s - jump_s, message)
        for at_s, message in arriving(70.0, Rate.FPS_30, 1.0, late(0.002, 2))
        if at_s >= 20.0 + jump_s
    ]
    following = Following([*first, *second]).run(60.0, START.time_s(Rate.FPS_30) + 1.0)
    time_s, clock_s, tempo = following.table.T
    flown = time_s > 3.0
    steps_s = np.diff(clock_s[flown])
    assert 0.0 <= steps_s.min() <= steps_s.max() <= 1.1 * TICK_S + 1e-9
    assert np.abs(np.diff(tempo[flown])).max() <= CHANGE_PER_S * TICK_S + 1e-9
    true_s = START.time_s(Rate.FPS_30) + time_s + jump_s
    assert np.abs(clock_s - true_s)[time_s > 55.0].max() < 0.02
    assert ChaseState.REFUSED not in {row[3] for row in following.at}


@pytest.mark.parametrize("jump_s", [30.0, -15.0])
def test_a_large_jump_is_refused_and_the_show_stands(jump_s: float) -> None:
    first = list(arriving(20.0, Rate.FPS_25, 1.0, late(0.002, 1)))
    second = [
        (at_s - jump_s, message)
        for at_s, message in arriving(90.0, Rate.FPS_25, 1.0, late(0.002, 2))
        if at_s >= 20.0 + jump_s
    ]
    following = Following([*first, *second]).run(30.0, START.time_s(Rate.FPS_25) + 1.0)
    time_s, clock_s, tempo = following.table.T
    assert following.at[-1][3] is ChaseState.REFUSED
    assert following.chase.jump_s == pytest.approx(jump_s, abs=12.0)
    assert tempo[time_s > 24.0].max() == 0.0
    assert clock_s[-1] - START.time_s(Rate.FPS_25) < 23.0


def test_a_few_wrong_readings_do_not_move_the_show() -> None:
    chase = Chase(freewheel_s=1.0, jump_max_s=5.0)
    for number in range(200):
        at_s = number * 0.01
        chase.take(Reading(100.0 + at_s, Rate.FPS_25), at_s)
        if number > 100 and number % 10 < 4:
            chase.take(Reading(103.0 + at_s, Rate.FPS_25), at_s)
    assert chase.time_s(2.0) == pytest.approx(102.0, abs=1e-6)
    assert chase.state(2.0) is ChaseState.RUNNING


def test_a_source_that_repeats_one_frame_stands() -> None:
    chase = Chase(freewheel_s=1.0, jump_max_s=5.0)
    for number in range(300):
        at_s = number * 0.04
        chase.take(Reading(100.0 + min(at_s, 4.0), Rate.FPS_25), at_s)
    assert chase.state(12.0) is ChaseState.STOPPED
    assert chase.time_s(12.0) == pytest.approx(104.0, abs=0.15)


def test_a_silent_source_is_lost_another_says_that_it_stopped() -> None:
    midi, chase = MidiTimecode(), Chase(freewheel_s=1.0, jump_max_s=5.0)
    assert chase.state(0.0) is ChaseState.NONE
    for at_s, message in arriving(3.0, Rate.FPS_25, 1.0, late(0.002, 1)):
        for reading in midi.take(message):
            chase.take(reading, at_s)
    assert [chase.state(at_s) for at_s in (3.0, 3.5, 5.0)] == [
        ChaseState.RUNNING,
        ChaseState.DROPPED_OUT,
        ChaseState.LOST,
    ]
    for reading in midi.take(full_frame(Label(1, 0, 3, 0), Rate.FPS_25)):
        chase.take(reading, 6.0)
    assert [chase.state(at_s) for at_s in (6.0, 600.0)] == [ChaseState.STOPPED] * 2
    for at_s, message in arriving(3.0, Rate.FPS_25, 1.0, late(0.002, 1)):
        for reading in midi.take(message):
            chase.take(reading, 700.0 + at_s)
    assert [chase.state(at_s) for at_s in (703.0, 705.0)] == [ChaseState.RUNNING, ChaseState.LOST]


def test_a_full_frame_counts_before_the_show_only() -> None:
    midi, chase = MidiTimecode(), Chase(freewheel_s=1.0, jump_max_s=5.0)
    for place in (Label(10, 0, 0, 0), Label(1, 0, 0, 0)):
        for reading in midi.take(full_frame(place, Rate.FPS_25)):
            chase.take(reading, 1.0)
        assert chase.time_s(1.0) == place.time_s(Rate.FPS_25)
        assert chase.state(1.0) is ChaseState.STOPPED
    chase.show_s = 3600.0
    for reading in midi.take(full_frame(Label(5, 0, 0, 0), Rate.FPS_25)):
        chase.take(reading, 2.0)
    assert chase.time_s(2.0) == 3600.0


@pytest.mark.parametrize(("behind_s", "expected"), [(0.0, 1.0), (10.0, 1.1), (-10.0, 0.0), (0.02, 1.02)])
def test_the_tempo_stays_within_its_bounds(behind_s: float, expected: float) -> None:
    assert desired_rate(behind_s, 1.0, 0.1) == pytest.approx(expected)


@pytest.mark.alternates(0)
@pytest.mark.parametrize("rate", Rate)
@pytest.mark.parametrize("begins", [Label(23, 59, 54, 0), Label(23, 59, 58, 0), Label(0, 0, 4, 0)])
def test_a_timecode_that_is_the_time_of_day_passes_midnight(rate: Rate, begins: Label) -> None:
    """A show of New Year that begins before midnight, or after it, follows the timecode all the time."""
    start = Label(23, 59, 50, 0)
    messages = [(one.at_s, one.message) for one in _until(start, rate, 30.0)]
    labelled = rate.nominal
    begin_s, from_s = begins.time_s(labelled), start.time_s(labelled)
    begin_s += labelled.day_s if begin_s < from_s else 0.0
    following = Following(messages, start=start).run(30.0, begin_s)
    assert following.chase.rate is rate
    time_s, clock_s, _ = following.table.T
    flown = time_s > 22.0
    assert np.abs(clock_s - start.time_s(rate) - time_s)[flown].max() <= 0.020
    assert {row[3] for row in following.at if row[0] > 1.0} == {ChaseState.RUNNING}


def _until(start: Label, rate: Rate, seconds: float) -> Iterator[Sent]:
    return takewhile(lambda one: one.at_s < seconds, running(start, rate))


def test_back_over_midnight_is_a_small_jump_too() -> None:
    """The source is set back by 4 s, from 00:00:02 to 23:59:58: slewed, as at any other time."""
    rate = Rate.FPS_25
    first = [(one.at_s, one.message) for one in _until(Label(23, 59, 52, 0), rate, 10.0)]
    again = [(10.0 + one.at_s, one.message) for one in _until(Label(23, 59, 58, 0), rate, 20.0)]
    following = Following(first + again).run(30.0, Label(23, 59, 54, 0).time_s(rate))
    time_s, clock_s, _ = following.table.T
    assert clock_s[-1] == pytest.approx(Label(23, 59, 58, 0).time_s(rate) + time_s[-1] - 10.0, abs=0.05)
    assert ChaseState.REFUSED not in {row[3] for row in following.at}


def test_a_jump_over_midnight_is_as_long_as_it_is() -> None:
    """From 23:59:57 to 00:05:00: five minutes, not a day less five minutes."""
    rate = Rate.FPS_30
    first = [(one.at_s, one.message) for one in _until(Label(23, 59, 52, 0), rate, 5.0)]
    again = [(5.0 + one.at_s, one.message) for one in _until(Label(0, 5, 0, 0), rate, 5.0)]
    following = Following(first + again).run(5.9, Label(23, 59, 53, 0).time_s(rate))
    assert following.at[-1][3] is ChaseState.REFUSED
    assert following.chase.jump_s == pytest.approx(303.0, abs=1.0)


@pytest.mark.parametrize(
    ("labelled", "true"), [(Rate.FPS_24, Rate.FPS_23_976), (Rate.FPS_30, Rate.FPS_29_97)]
)
@pytest.mark.parametrize("off", [0.9999, 1.0001])
def test_a_rate_of_film_and_video_is_recognised_by_the_clock(labelled: Rate, true: Rate, off: float) -> None:
    """Labels of 24 or 30 frames that run slower by 1001/1000: the show keeps to the music, not to the labels.

    The source's clock is off by 100 ppm; jitter of 5 ms. An hour in, labels alone would be 3.6 s late.
    """
    messages = list(arriving(90.0, true, off, late(0.005, seed=7), drop_outs=0.3))
    following = Following(messages).run(90.0, START.time_s(labelled) + 1.0)
    assert following.chase.rate is true
    time_s, clock_s, tempo = following.table.T
    flown = time_s > 20.0
    assert np.abs(clock_s - START.time_s(true) - time_s * off)[flown].max() <= 0.020
    assert tempo[flown].mean() == pytest.approx(off, abs=5e-5)


@pytest.mark.parametrize("rate", NAMED)
@pytest.mark.parametrize("off", [0.9999, 1.0001, 0.9985])
def test_no_other_timecode_is_taken_for_it(rate: Rate, off: float) -> None:
    """Clocks that are off, and a tape that runs slowly: followed as labelled."""
    following = Following(list(arriving(40.0, rate, off, late(0.005, seed=3)))).run(
        40.0, START.time_s(rate) + 1.0
    )
    assert following.chase.rate is rate
    assert following.clock_s == pytest.approx(START.time_s(rate) + following.at[-1][0] * off, abs=0.02)


def test_a_rate_that_is_recognised_late_makes_no_jump() -> None:
    """The show begins with the timecode's third second, and its rate is known after fifteen."""
    following = Following(list(arriving(40.0, Rate.FPS_29_97, 1.0, late(0.002, seed=2))))
    following.run(40.0, START.time_s(Rate.FPS_30) + 3.0)
    time_s, _, tempo = following.table.T
    assert following.chase.rate is Rate.FPS_29_97
    assert np.abs(tempo[time_s > 6.0] - 1.0).max() <= 0.02
