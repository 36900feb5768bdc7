"""The time from our TIMESYNC to a vehicle's answer; nothing else counts as one."""

import asyncio

import async_solipsism
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.support.published import PublishedVehicle, as_shipped, released

THEIRS_NS = 42


def sync(theirs_ns: int, ours_ns: int) -> dialect.MAVLink_timesync_message:
    return dialect.MAVLink_timesync_message(theirs_ns, ours_ns)


async def asked_and_answered(answer_s: float, answer_to: int) -> tuple[float, int]:
    """A vehicle answers a request of ours (-1: the newest), so long after the newest; others ask and answer.

    Returns: the round trip, and how many requests there were in 5 s.
    """
    one = PublishedVehicle("px4", as_shipped("px4", "1.16"), released("1.16"))
    tasks = [asyncio.create_task(each) for each in (one.live(), one.link.run())]
    for _ in range(100):
        one.link.snapshot()
        await asyncio.sleep(0.05)
    requests = [message.ts1 for _, message in one.ports.sent if message.get_type() == "TIMESYNC"]
    one.ports.say(sync(0, requests[-1]))  # a request of the vehicle's own
    one.ports.say(sync(THEIRS_NS, requests[-1] + 1))  # an answer to somebody else
    one.link.snapshot()
    assert np.isnan(one.link.snapshot().round_trip_s[0])
    now_ns = asyncio.get_running_loop().time() * 1e9
    await asyncio.sleep(max(0.0, answer_s - (now_ns - requests[-1]) * 1e-9))
    one.ports.say(sync(THEIRS_NS, requests[answer_to]))
    measured_s = float(one.link.snapshot().round_trip_s[0])
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return measured_s, len(requests)


def measured(answer_s: float, answer_to: int = -1) -> tuple[float, int]:
    with asyncio.Runner(loop_factory=async_solipsism.EventLoop) as runner:
        return runner.run(asked_and_answered(answer_s, answer_to))


def test_answer_to_the_newest_request_is_the_round_trip() -> None:
    round_trip_s, requests = measured(0.95)
    assert round_trip_s == pytest.approx(0.95, abs=0.06)
    assert requests == 5


def test_answer_to_an_older_request_counts_from_that_request() -> None:
    assert measured(0.95, answer_to=-2)[0] == pytest.approx(2.0, abs=0.1)
