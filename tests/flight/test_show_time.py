"""The control loop's time: late ticks, old telemetry, and a link that fails."""

import asyncio
import logging

import numpy as np
import pytest

from gcs.flight.state.ticker import TickClock, ticks
from gcs.links.batch_link import Link
from gcs.model.errors import LinkError
from gcs.model.lifecycle import Phase
from gcs.model.state import Array, Setpoints
from gcs.sim.vehicle.px4 import Quirks
from gcs.testing.virtual_link import VirtualLink
from gcs.testing.virtual_show import FLEET_STEP_S, VirtualShow, fly, show_config
from gcs.testing.virtual_time import run_virtual
from tests.support.show_phases import running


async def some_ticks(takes_s: list[float]) -> list[tuple[float, float, int]]:
    """Ticks of a tenth of a second; each takes as long as it is told."""
    seen: list[tuple[float, float, int]] = []
    async for tick in ticks(0.1):
        seen.append(tick)
        if len(seen) > len(takes_s):
            break
        await asyncio.sleep(takes_s[len(seen) - 1])
    return seen


@pytest.mark.parametrize(
    ("takes_s", "at_s", "missed"),
    [
        ([0.0, 0.0, 0.0], [0.0, 0.1, 0.2, 0.3], [0, 0, 0, 0]),
        ([0.25, 0.0], [0.0, 0.3, 0.4], [0, 2, 0]),
        ([0.15, 0.15, 0.02], [0.0, 0.2, 0.4, 0.5], [0, 1, 1, 0]),
        ([0.04, 1.01, 0.04], [0.0, 0.1, 1.2, 1.3], [0, 0, 10, 0]),
    ],
)
def test_late_ticks_are_dropped(takes_s: list[float], at_s: list[float], missed: list[int]) -> None:
    seen = run_virtual(lambda: some_ticks(takes_s))
    assert [now_s for now_s, _, _ in seen] == pytest.approx(at_s)
    assert [due_s for _, due_s, _ in seen] == pytest.approx(at_s)
    assert [dropped for _, _, dropped in seen] == missed


async def many_ticks() -> list[float]:
    return [now_s for now_s, _, _ in await some_ticks([0.003] * 5000)]


def test_ticks_do_not_drift() -> None:
    times_s = run_virtual(many_ticks)
    assert times_s == pytest.approx([0.1 * index for index in range(5001)], abs=1e-6)


def test_clock_counts_ticks_and_reports_percentiles_each_second() -> None:
    clock = TickClock(10.0)
    for index in range(21):
        clock.note(0.1 * index, 0.001 if index else 0.003, 0.002, missed=1 if index == 5 else 0)
    reported = clock.summary()
    assert (reported.count, reported.missed, reported.rate_hz) == (21, 1, 10.0)
    assert reported.duration_p50_ms == pytest.approx(1.0)
    assert reported.duration_p99_ms is not None
    assert 1.0 < reported.duration_p99_ms <= 3.0
    assert reported.lateness_p99_ms == pytest.approx(2.0)
    assert clock.gap_s == pytest.approx(0.1)
    clock.note(2.9, 0.5, 0.5, missed=0)
    assert clock.summary() == reported
    assert clock.gap_s == pytest.approx(0.9), "what the view calls control that is not alive"


async def a_second_without_telemetry(show: VirtualShow) -> tuple[list[float], list[float], set[Phase]]:
    """Only what comes from d2 is lost, for less than its autopilot's patience; d1's goes on."""
    await show.wait(0.04)  # right after a position
    began_s = show.now_s
    show.ports.silence("d2", up=False)
    await show.wait(1.2)
    show.ports.restore("d2")
    await show.wait(1.0)
    sent_s = {
        name: [setpoint.time_s - began_s for setpoint in show.ports.sent[name] if setpoint.time_s > began_s]
        for name in ("d1", "d2")
    }
    return sent_s["d1"], sent_s["d2"], {seen.phase for seen in show.track.between(began_s).of("d2")}


def test_stale_telemetry_sends_no_setpoint_others_unaffected() -> None:
    others_s, own_s, phases = fly(
        a_second_without_telemetry, show_config(2), after=running, step_s=FLEET_STEP_S, quirks=Quirks()
    )
    gap = int(np.argmax(np.diff(own_s)))
    assert 0.4 < own_s[gap] < 0.56
    assert 1.19 < own_s[gap + 1] < 1.3
    assert np.diff(others_s) == pytest.approx(np.full(len(others_s) - 1, 0.05), abs=1e-6)
    assert phases == {Phase.FORMATION}


async def stale_batch(show: VirtualShow) -> tuple[int, int, int]:
    """Hand the link a batch that is too old, one that is not finite, and a good one."""
    await show.standby()
    link, now_s = show.link, show.now_s

    def sent_after(time_s: float, velocity: float) -> int:
        link.send(Setpoints(time_s, ("d1",), np.full((1, 3), velocity), np.zeros(1)))
        return link.setpoints_sent

    return sent_after(now_s - 0.21, 0.0), sent_after(now_s, np.nan), sent_after(now_s, 0.0)


def test_test_link_honours_the_watchdog_and_finite_values() -> None:
    assert fly(stale_batch, show_config(1)) == (0, 0, 1)


def test_test_link_satisfies_the_link_protocol() -> None:
    async def story(show: VirtualShow) -> str:
        link: Link = show.link
        return f"{link.name} {link.ids} {dict(link.conflicts)} {link.setpoints_sent}"

    assert fly(story, show_config(2)) == "loop ('d1', 'd2') {} 0"


def failures_logged(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.__dict__["cause"] for record in caplog.records if record.message == "link_failed"]


async def wait_until_received(show: VirtualShow) -> tuple[int, float]:
    await show.phase("d1", Phase.STANDBY)
    return show.link.runs, show.now_s


def test_link_that_cannot_open_is_retried_and_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    taken, gone = LinkError("port 14540 is taken"), LinkError("no such interface")
    with caplog.at_level(logging.ERROR):
        runs, received_s = fly(
            wait_until_received, show_config(1), failures=[taken, taken, gone, gone, taken]
        )
    assert failures_logged(caplog) == [str(taken), str(gone), str(taken)]
    assert runs == 6
    assert 1.24 < received_s < 4.5  # a quarter of a second after each failure; then its first position


async def fails_again_later(show: VirtualShow) -> VirtualLink:
    await show.phase("d1", Phase.STANDBY)
    show.link.failures.put_nowait(LinkError("port 14540 is taken"))
    await show.wait(3.0)
    return show.link


def test_link_that_fails_again_is_logged_again(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.ERROR):
        link = fly(
            fails_again_later,
            show_config(1),
            failures=[LinkError("port 14540 is taken")],
            quirks=Quirks(),
        )
    assert failures_logged(caplog) == ["port 14540 is taken"] * 2
    assert link.runs == 3


class BugError(Exception):
    """Not among those that are expected."""


async def a_bug(show: VirtualShow) -> None:
    def broken(setpoints: Setpoints) -> Array:
        raise BugError

    await show.standby()
    show.link.prepare = broken  # type: ignore[method-assign]
    await show.wait(1.0)


def test_a_bug_in_the_control_group_ends_it_and_is_not_swallowed() -> None:
    with pytest.raises(ExceptionGroup) as ended:
        fly(a_bug, show_config(1))
    assert ended.group_contains(BugError)
