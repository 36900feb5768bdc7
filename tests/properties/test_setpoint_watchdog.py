from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as dialect

from gcs.links.address_book import Addresses
from gcs.links.command_protocol import KillLatch
from gcs.links.endpoints.mmsg import Batch
from gcs.links.endpoints.ports import Ports
from gcs.links.link import Counters
from gcs.links.mavsdk.setpoint_filter import SetpointFilter
from gcs.links.sender import Outbox, SentSetpoints, SetpointBatch
from gcs.mavlink.codec import split

HOLD_S = 0.2
SYSTEM_IDS = np.array([1, 2, 3])
MAVSDK = dialect.MAVLink(None, srcSystem=245, srcComponent=190)
STEP_S = st.floats(0, 0.5)
ROWS = st.frozensets(st.integers(0, 2))
STEPS = st.one_of(
    st.tuples(st.just("tick"), STEP_S, ROWS),
    st.tuples(st.just("write"), STEP_S, st.tuples(st.integers(0, 5), st.integers(0, 12))),
    st.tuples(st.just("kill"), STEP_S, st.integers(0, 2)),
)


class MemoryPorts(Ports):
    """Frames that have left, with their times; the clock may go on between two frames."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.left: list[tuple[float, bytes]] = []

    def open(self) -> None:
        return

    def close(self) -> None:
        return

    def receive(self, take: Any) -> None:
        return

    def send(self, data: Any, length: Any, destination: Any, *, until_s: float = np.inf) -> Any:
        gone = np.zeros(len(destination), np.bool_)
        for at in np.flatnonzero(destination >= 0):
            if self.now_s <= until_s:
                self.left.append((self.now_s, data[at, : length[at]].tobytes()))
                gone[at] = True
            self.now_s += 0.05
        return gone


def written(target: int, tick: int) -> Batch:
    """A setpoint as MAVSDK writes it: its velocity is that of one tick."""
    batch = Batch(1, 300)
    raw = bytes(
        dialect.MAVLink_set_position_target_local_ned_message(
            0, target, 1, 1, 0x9C7, 0, 0, 0, float(tick), 0.0, 0.0, 0, 0, 0, 1.5, 0
        ).pack(MAVSDK)
    )
    batch.data[0, : len(raw)] = np.frombuffer(raw, np.uint8)
    batch.length[0] = len(raw)
    return batch


@given(st.lists(STEPS, max_size=30))
@settings(max_examples=300, deadline=None)
def test_only_the_newest_ticks_setpoints_leave_once_and_in_time(steps: list[Any]) -> None:
    """Whatever MAVSDK writes, and whenever: repetitions, old setpoints, setpoints of vehicles not listed."""
    ports, counters = MemoryPorts(), Counters()
    addresses = Addresses("bench", (1, 2, 3), ports.address, counters, lambda: ports.now_s)
    addresses.source[:] = 7
    outbox, latch = Outbox(ports, addresses, counters, SYSTEM_IDS), KillLatch((1, 2, 3))
    sent = SentSetpoints(3)
    passing = SetpointFilter(outbox, SYSTEM_IDS, latch, sent, counters, lambda: ports.now_s)
    tick, until_s, listed = 0, -1e9, frozenset[int]()
    for what, step_s, about in steps:
        ports.now_s += step_s
        before = len(ports.left)
        if what == "tick":
            tick, listed, until_s = tick + 1, about, ports.now_s + HOLD_S
            rows = np.array(sorted(listed), np.int64)
            velocity_m_s = np.zeros((len(rows), 3))
            velocity_m_s[:, 0] = tick
            passing.expect(SetpointBatch(rows, velocity_m_s, np.zeros(len(rows)), until_s))
        elif what == "kill":
            latch.shut(about + 1)
            passing.forbid(np.array([about]))
            listed -= {about}
        else:
            target, of_tick = about
            passing.take(written(target, of_tick), 1)
        for left_s, raw in ports.left[before:]:
            (frame,) = split(raw).frames
            assert left_s <= until_s
            assert frame.payload[16:20] == np.float32(tick).tobytes(), "of the newest tick"
            row = frame.payload[52] - 1
            assert row in listed, "listed in that tick, and not sent before"
            listed -= {row}


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
