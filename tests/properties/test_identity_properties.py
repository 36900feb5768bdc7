"""Whatever is lost: no vehicle takes the address of another, and each is followed to its new port."""

from hypothesis import given
from hypothesis import strategies as st

from gcs.links.continuity import CLOCK_OFF_S
from gcs.links.endpoints.ports import host_number, source_of
from gcs.mavlink.reports import SILENT_AFTER_S
from tests.support.address_bench import PERIOD_S, Book, Sender

A = source_of(host_number("127.0.0.1"), 14582, 0)
B = source_of(host_number("127.0.0.1"), 14599, 0)
STEPS = 120
KNOWN_AFTER = 40
"""Steps until the streams of a vehicle are known."""

lost = st.lists(st.booleans(), min_size=STEPS, max_size=STEPS)
seldom = st.sets(st.integers(0, STEPS - 1), max_size=STEPS // 4)


def datagram(sender: Sender, step: int) -> bytes:
    beat = sender.beat() if step % 10 == 0 else b""
    return beat + sender.position(step * PERIOD_S) + sender.status()


@given(
    lost_a=seldom,
    lost_b=lost,
    boot_s=st.floats(-100.0, 100.0).filter(lambda off_s: abs(off_s) > 2.0 * CLOCK_OFF_S),
    number=st.integers(0, 255),
    begins=st.integers(1, STEPS),
)
def test_another_vehicle_takes_no_address_whatever_is_lost(
    lost_a: set[int], lost_b: list[bool], boot_s: float, number: int, begins: int
) -> None:
    book, other = Book(), Sender(boot_s=-200.0 + boot_s, number=number)
    book.vehicle.boot_s = -200.0
    book.take(datagram(book.vehicle, 0), A, 0.0)
    received_s = 0.0
    for step in range(1, STEPS):
        time_s, raw, other_raw = step * PERIOD_S, datagram(book.vehicle, step), datagram(other, step)
        if step not in lost_a:
            assert book.take(raw, A, time_s) > 0
            received_s = time_s
        if step >= begins and not lost_b[step] and time_s - received_s <= SILENT_AFTER_S:
            assert book.take(other_raw, B, time_s) == 0
    assert book.of.source[0] == A


@given(lost_a=seldom, changes=st.sets(st.integers(KNOWN_AFTER, STEPS - 10), min_size=1, max_size=5))
def test_a_vehicle_keeps_its_link_wherever_its_port_changes(lost_a: set[int], changes: set[int]) -> None:
    book, source, silent_s = Book(), A, 0.0
    for step in range(STEPS):
        source += step in changes
        raw, time_s = datagram(book.vehicle, step), step * PERIOD_S
        if step not in lost_a and book.take(raw, source, time_s):
            silent_s = time_s
        lacking = len([each for each in range(round(silent_s / PERIOD_S) + 1, step + 1) if each in lost_a])
        changed = len([each for each in changes if silent_s < each * PERIOD_S <= time_s + 1e-6])
        assert time_s - silent_s <= PERIOD_S * (lacking + 5 * changed) + 1e-6
    assert book.of.conflicts() == {}
