from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from gcs.links.kill_latch import KillLatch
from gcs.links.setpoint_watchdog import SetpointWatchdog

HOLD_S = 0.2
SYSTEMS = st.integers(0, 5)
STEP_S = st.floats(0, 0.5)
REFRESH = st.tuples(st.just("refresh"), STEP_S, st.frozensets(SYSTEMS))
ASK = st.tuples(st.just("ask"), STEP_S, SYSTEMS)


@given(st.lists(st.one_of(REFRESH, ASK)))
def test_no_setpoint_after_the_hold_time_since_its_last_tick(
    steps: list[Any],
) -> None:
    setpoint_watchdog = SetpointWatchdog(HOLD_S)
    now_s = 100.0
    last_s = -1e9
    listed: frozenset[int] = frozenset()
    for what, step_s, about in steps:
        now_s += step_s
        if what == "refresh":
            setpoint_watchdog.refresh(about, now_s)
            last_s, listed = now_s, about
        else:
            allowed = about in listed and about != 0 and now_s <= last_s + HOLD_S
            assert setpoint_watchdog.allows(about, now_s) == allowed


@given(st.lists(st.sampled_from(["kill", "order", "turn"])))
def test_no_command_from_before_a_kill_opens_the_latch(events: list[str]) -> None:
    latch = KillLatch([1])
    waiting: list[tuple[int, int]] = []
    kills = 0
    for event in events:
        if event == "kill":
            latch.shut(1)
            kills += 1
        elif event == "order":
            waiting.append((latch.ticket(1), kills))
        elif waiting:
            ticket, kills_before = waiting.pop(0)
            fresh = kills_before == kills
            assert latch.redeem(1, ticket) == fresh
            assert latch.is_shut(1) == (not fresh)
