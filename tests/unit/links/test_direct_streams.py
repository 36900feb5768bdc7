"""Intervals are asked for one after the other, of every vehicle at once, and again when a vehicle forgot."""

import numpy as np

from gcs.links.udp.stream_requests import Streams
from gcs.mavlink.codec import Records, records
from gcs.mavlink.framing import SET_MESSAGE_INTERVAL
from gcs.mavlink.kernels import Whole

RATES_HZ = {33: 10.0, 30: 0.0}
BOTH = np.ones(2, np.bool_)


class Bench:
    """Two vehicles and what they were asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[int, int, float]] = []  # system, message, interval
        self.connection_count = np.ones(2, np.int64)
        self.streams = Streams(np.array([5, 6]), RATES_HZ, self.tell)

    def tell(self, _message_id: int, messages: Records, _rows: Whole) -> None:
        for message in messages:
            asked = int(message["target_system"]), int(message["param1"]), float(message["param2"])
            self.asked.append(asked)

    def watch(self, now_s: float, connected: "np.ndarray[tuple[int], np.dtype[np.bool_]]" = BOTH) -> None:
        self.streams.watch(connected, self.connection_count, np.full(2, round(now_s * 10)), now_s)

    def answer(self, *rows: int) -> None:
        reported = records(77, len(rows))
        reported["command"] = SET_MESSAGE_INTERVAL
        self.streams.take_acks(np.array(rows), reported)


def test_each_interval_is_requested_after_the_previous_answer() -> None:
    bench = Bench()
    bench.watch(0.0)
    assert bench.asked == [(5, 33, 100_000.0), (6, 33, 100_000.0)]
    bench.answer(0)
    bench.watch(0.1)
    assert bench.asked[2:] == [(5, 30, -1.0)]
    bench.answer(0)
    assert bench.streams.settled.tolist() == [True, False]


def test_unanswered_request_is_repeated_and_given_up_in_the_end() -> None:
    bench = Bench()
    bench.connection_count[1] = 0  # never received
    for now_s in np.arange(0.0, 10.0, 0.1):
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


def test_wrong_position_rate_is_requested_again_with_a_limit() -> None:
    bench = Bench()
    for step in range(1000):
        bench.streams.watch(
            BOTH, bench.connection_count, np.array([5 * step, step]), 0.1 * step
        )  # 50 Hz, and 10 Hz as asked
        bench.answer(0, 1)
    asked = [system_id for system_id, *_ in bench.asked]
    assert asked.count(6) == len(RATES_HZ)
    assert asked.count(5) == 6 * len(RATES_HZ)
