"""Signals that ask a service to stop: a closed terminal only ever asks once."""

import asyncio
import os
import signal
from collections.abc import Iterator, Sequence

import pytest

from gcs.cli.service.process import StopRequests
from gcs.cli.service.supervisor import pass_on

ALL = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """Handlers of signals as they were."""
    before = {number: signal.getsignal(number) for number in ALL}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def requested(numbers: Sequence[int]) -> tuple[bool, bool]:
    """Whether these signals ask for a stop, and for one at once."""

    async def received() -> tuple[bool, bool]:
        stop = StopRequests()
        for number in numbers:
            os.kill(os.getpid(), number)
            await asyncio.sleep(0.01)
        return stop.first.is_set(), stop.second.is_set()

    return asyncio.run(received())


@pytest.mark.parametrize(
    ("numbers", "first", "second"),
    [
        ((signal.SIGINT,), True, False),
        ((signal.SIGINT, signal.SIGTERM), True, True),
        ((signal.SIGHUP, signal.SIGHUP, signal.SIGHUP), True, False),
        ((signal.SIGHUP, signal.SIGTERM), True, False),
        ((signal.SIGTERM, signal.SIGHUP), True, False),
        ((signal.SIGHUP, signal.SIGTERM, signal.SIGINT), True, True),
    ],
)
def test_only_signals_of_an_operator_stop_at_once(numbers: Sequence[int], first: bool, second: bool) -> None:
    assert requested(numbers) == (first, second)


def test_ignored_hang_up_stays_ignored() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    assert requested((signal.SIGHUP,)) == (False, False)
    passed_on: list[int] = []
    pass_on(passed_on)
    os.kill(os.getpid(), signal.SIGHUP)
    assert passed_on == []


def test_parent_passes_a_hang_up_on_as_such() -> None:
    passed_on: list[int] = []
    pass_on(passed_on)
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        os.kill(os.getpid(), number)
    assert passed_on == [signal.SIGTERM, signal.SIGHUP, signal.SIGTERM]
