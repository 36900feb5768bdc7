"""Intervals are requested one after the other, for all vehicles at once, and again when one forgot."""

import numpy as np
import pytest

from gcs.links.settings import StreamSettings
from gcs.links.stream_requests import REQUESTING_COMPONENT, StreamRequests, desired_rates
from gcs.mavlink.codec import AUTOPILOT_COMPONENT, SYSTEM_ID, Records, records
from gcs.mavlink.framing import SET_MESSAGE_INTERVAL
from gcs.mavlink.kernels import COMPONENT, FRAME_COLUMNS, MESSAGE, Whole

RATES_HZ = {33: 10.0, 30: 0.0}
BOTH = np.ones(2, np.bool_)


class Bench:
    """Two vehicles, the requests to them, and the rates at which they send."""

    def __init__(self) -> None:
        self.asked: list[tuple[int, int, float]] = []  # system, message, interval
        self.connection_count = np.ones(2, np.int64)
        self.streams = StreamRequests(np.array([5, 6]), (RATES_HZ, RATES_HZ), self.note)
        self.sends_hz = [dict(RATES_HZ), dict(RATES_HZ)]
        self.now_s = 0.0

    def note(self, _message_id: int, messages: Records, _rows: Whole) -> None:
        for message in messages:
            asked = int(message["target_system"]), int(message["param1"]), float(message["param2"])
            self.asked.append(asked)

    def watch(self, now_s: float, connected: "np.ndarray[tuple[int], np.dtype[np.bool_]]" = BOTH) -> None:
        self.streams.watch(connected, self.connection_count, now_s)

    def answer(self, *rows: int, to: tuple[int, int] = (0, 0)) -> None:
        reported = records(77, len(rows))
        reported["command"] = SET_MESSAGE_INTERVAL
        reported["target_system"], reported["target_component"] = to
        self.streams.take_acks(np.array(rows), reported)

    def run(self, seconds: float) -> None:
        """The vehicles send at their rates, and answer each request."""
        for _ in range(round(seconds / 0.05)):
            before_s, self.now_s = self.now_s, self.now_s + 0.05
            for row, sends_hz in enumerate(self.sends_hz):
                for message_id, rate_hz in sends_hz.items():
                    count = int(self.now_s * rate_hz) - int(before_s * rate_hz)
                    frames = np.zeros((count, FRAME_COLUMNS), np.int64)
                    frames[:, MESSAGE], frames[:, COMPONENT] = message_id, AUTOPILOT_COMPONENT
                    self.streams.count(np.full(count, row), frames)
            asked = len(self.asked)
            self.watch(self.now_s)
            if len(self.asked) > asked:
                self.answer(0, 1)


def test_each_interval_is_requested_after_the_previous_answer() -> None:
    bench = Bench()
    bench.watch(0.0)
    assert bench.asked == [(5, 33, 100_000.0), (6, 33, 100_000.0)]
    bench.answer(0)
    bench.watch(0.1)
    assert bench.asked[2:] == [(5, 30, -1.0)]
    bench.answer(0)
    assert bench.streams.settled.tolist() == [True, False]


def test_an_answer_to_another_sender_continues_nothing() -> None:
    bench = Bench()
    bench.watch(0.0)
    for to in ((255, REQUESTING_COMPONENT), (255, 0), (SYSTEM_ID, 190)):
        bench.answer(0, to=to)
    bench.watch(0.1)
    assert len(bench.asked) == 2
    bench.answer(0, to=(SYSTEM_ID, REQUESTING_COMPONENT))
    bench.watch(0.2)
    assert bench.asked[2:] == [(5, 30, -1.0)]


def test_unanswered_request_is_repeated_and_given_up_in_the_end() -> None:
    bench = Bench()
    bench.connection_count[1] = 0  # never received
    for now_s in np.arange(0.0, 6.0, 0.1):
        bench.watch(float(now_s), np.array([True, False]))
    assert [asked[1] for asked in bench.asked] == [33] * 4 + [30] * 4
    assert bench.streams.settled.tolist() == [True, True]


def test_streams_are_requested_again_after_silence_and_reboot() -> None:
    bench = Bench()

    def settle(now_s: float) -> int:
        for step in range(4):
            bench.watch(now_s + 0.01 * step)
            bench.answer(0, 1)
        return len(bench.asked)

    asked = settle(0.0)
    assert asked == 4
    bench.watch(1.0, np.array([False, True]))
    bench.connection_count[0] += 1
    assert settle(1.1) == asked + 2
    bench.connection_count[1] += 1
    bench.watch(2.0)
    assert bench.asked[-1][:2] == (6, 33)


@pytest.mark.keeps("33-60.0")
@pytest.mark.parametrize(("message_id", "rate_hz"), [(33, 60.0), (33, 0.0), (30, 20.0)])
def test_wrong_rate_is_requested_again_at_growing_intervals(message_id: int, rate_hz: float) -> None:
    bench = Bench()
    bench.sends_hz[0][message_id] = rate_hz
    bench.run(2.0)
    assert len(bench.asked) == 2 * len(RATES_HZ)
    bench.run(30.0)
    again = bench.asked[2 * len(RATES_HZ) :]
    assert {each[:2] for each in again} == {(5, message_id)}
    assert 2 <= len(again) <= 4
    bench.run(600.0)
    assert len(bench.asked) <= 2 * len(RATES_HZ) + 16
    bench.sends_hz[0] = dict(RATES_HZ)
    bench.run(130.0)
    before = len(bench.asked)
    bench.run(600.0)
    assert len(bench.asked) == before


def test_positions_are_requested_at_ten_hertz_by_default() -> None:
    assert desired_rates(StreamSettings())[33] == 10.0
    assert desired_rates(StreamSettings(position_hz=4.0))[33] == 4.0
    rates_hz = desired_rates(StreamSettings(others_hz=2.0))
    assert (rates_hz[31], rates_hz[245], rates_hz[1]) == (2.0, 5.0, 2.0)


def test_attitudes_are_requested_for_the_wind_and_for_others() -> None:
    assert desired_rates(StreamSettings())[30] == 4.0
    assert desired_rates(StreamSettings(others_hz=10.0))[30] == 10.0
    assert desired_rates(StreamSettings(attitude_hz=0.0))[30] == 0.0


def test_reset_counter_stream_is_always_requested() -> None:
    assert desired_rates(StreamSettings())[331] == 1.0
