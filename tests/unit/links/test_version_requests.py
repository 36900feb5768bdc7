"""AUTOPILOT_VERSION is requested on connection and after a reboot, a few times, and read."""

import asyncio

import async_solipsism
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.links.autopilots.versions import Version
from gcs.links.version_requests import VersionRequests
from gcs.mavlink.codec import Records
from gcs.mavlink.kernels import Whole
from tests.support.published import PublishedVehicle, as_shipped, released

BOTH = np.ones(2, np.bool_)


class Bench:
    """Two vehicles, and the requests to them: time, system, command, first parameter."""

    def __init__(self) -> None:
        self.asked: list[tuple[float, int, int, float]] = []
        self.connection_count, self.version_time_s = np.ones(2, np.int64), np.full(2, -np.inf)
        self.requests = VersionRequests(np.array([5, 6]), self.note)
        self.now_s = 0.0

    def note(self, _message_id: int, messages: Records, _rows: Whole) -> None:
        for each in messages:
            asked = int(each["target_system"]), int(each["command"]), float(each["param1"])
            self.asked.append((self.now_s, *asked))

    def run(self, seconds: float) -> list[tuple[int, int, float]]:
        """Let the time pass; what was asked in it."""
        before = len(self.asked)
        for _ in range(round(seconds / 0.1)):
            self.requests.watch(BOTH, self.connection_count, self.version_time_s, self.now_s)
            self.now_s = round(self.now_s + 0.1, 1)
        return [each[1:] for each in self.asked[before:]]


def test_unanswered_requests_end_after_six_each() -> None:
    bench = Bench()
    bench.connection_count[1] = 0  # never received
    asked = bench.run(60.0)
    assert asked == [(5, 512, 148.0), (5, 520, 1.0)] * 3
    assert np.diff([each[0] for each in bench.asked]).min() >= 1.0


def test_answer_ends_them_and_a_new_connection_asks_again() -> None:
    bench = Bench()
    assert [each[0] for each in bench.run(0.5)] == [5, 6]
    bench.version_time_s[:] = bench.now_s
    assert bench.run(10.0) == []
    bench.connection_count[0] += 1  # a reboot
    assert bench.run(0.5) == [(5, 512, 148.0)]
    bench.version_time_s[0] = bench.now_s
    assert bench.run(10.0) == []


def test_version_is_read_and_again_after_a_reboot() -> None:
    async def main() -> tuple[list[int], list[int]]:
        one = PublishedVehicle("px4", as_shipped("px4", "1.16"), released("1.16"))
        tasks = [asyncio.create_task(each) for each in (one.live(), one.link.run())]
        read = [one.link.snapshot().version[0]]

        async def boot(boot_ms: int, seconds: float) -> None:
            for tick in range(round(seconds / 0.05)):
                clock_ms = boot_ms + 50 * tick
                one.ports.say(dialect.MAVLink_global_position_int_message(clock_ms, 0, 0, 0, 0, 0, 0, 0, 0))
                one.link.snapshot()
                await asyncio.sleep(0.05)
            read.append(one.link.snapshot().version[0])

        await boot(90_000, 3.0)
        one.version = released("1.18")  # other firmware
        await boot(50, 3.0)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return read, [each for each in one.commands if each in {512, 520}]

    with asyncio.Runner(loop_factory=async_solipsism.EventLoop) as runner:
        read, asked = runner.run(main())
    assert [str(Version.of(each)) for each in read] == ["None", "1.16.0", "1.18.0"]
    assert asked == [512, 512]
