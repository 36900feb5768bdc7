import logging
from functools import partial

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.links.address_book import BOTH_S, CONFLICT_KEPT_S, UNLIKE_MAX
from gcs.links.continuity import SILENT_MAX_S, STRAYS_S
from gcs.links.endpoints.ports import Datagrams, host_number, source_of
from gcs.links.link import Address
from gcs.links.odd_frames import JUDGED_MAX
from gcs.links.senders import NOWHERE
from gcs.mavlink.codec import find
from gcs.mavlink.reports import SILENT_AFTER_S
from tests.support.address_bench import PERIOD_S, Book, Sender
from tests.support.work import lines_run

A = source_of(host_number("127.0.0.1"), 14582, 0)
B = source_of(host_number("127.0.0.1"), 14599, 0)
TEXT = "system id 3 at 127.0.0.1:14582 and at 127.0.0.1:14599"

NONE = dialect.MAV_AUTOPILOT_INVALID
COMPANION, GIMBAL, CAMERA, ADSB, RADIO = 191, 154, 100, 156, 68


def test_vehicle_is_reached_at_its_latest_address() -> None:
    book = Book()
    assert book.of.address(0) is None
    assert book.take(book.vehicle.beat(), A, 0.0) == 1
    assert book.take(book.vehicle.beat(), A, 0.1) == 1
    assert book.of.address(0) == Address("127.0.0.1", 14582, 0)
    assert book.of.received_s.tolist() == [0.1, -np.inf]


def test_system_id_not_configured_is_unknown() -> None:
    book = Book()
    assert book.take(Sender(255).beat(), A, 0.0) == 0
    assert book.counters.strangers == 1
    assert book.of.source.tolist() == [NOWHERE, NOWHERE]


def test_a_duplicate_is_refused_and_both_addresses_are_named() -> None:
    book, other = Book(), Sender(number=200)
    book.take(book.vehicle.beat(), A, 0.0)
    assert [book.take(other.beat(), B, time_s) for time_s in (1.0, 1.1)] == [0, 0]
    assert book.of.source[0] == A
    assert book.of.conflicts() == {0: TEXT}
    assert book.counters.duplicates == 2


def test_a_conflict_ends_when_the_duplicate_has_been_silent() -> None:
    book = Book()
    book.take(book.vehicle.beat(), A, 0.0)
    book.take(Sender(number=200).beat(), B, 1.0)
    book.now_s = 1.0 + CONFLICT_KEPT_S
    assert book.of.conflicts() == {0: TEXT}
    book.now_s += 0.1
    assert book.of.conflicts() == {}


def test_each_new_conflict_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    book, other = Book(), Sender(number=200)
    caplog.set_level(logging.INFO)
    for sender, source, time_s in (
        *((book.vehicle, A, 0.0), (other, B, 1.0), (other, B, 1.1)),
        *((book.vehicle, A, 8.0), (other, B, 8.5)),
    ):
        book.take(sender.beat(), source, time_s)
    assert caplog.messages == ["vehicle_connected", "duplicate_system_id", "duplicate_system_id"]


def test_silent_vehicle_may_return_from_another_address() -> None:
    book, restarted = Book(), Sender(number=200)
    book.take(book.vehicle.beat(), A, 0.0)
    assert book.take(restarted.beat(), B, SILENT_AFTER_S) == 0
    assert book.take(restarted.beat(), B, SILENT_AFTER_S + 0.1) == 1
    assert book.of.source[0] == B
    assert book.of.conflicts() == {}


def test_address_that_is_gone_frees_its_system_ids() -> None:
    book = Book()
    book.take(book.vehicle.beat(), A, 0.0)
    book.take(Sender(4).beat(), B, 0.0)
    book.of.forget([A])
    assert book.of.source.tolist() == [NOWHERE, B]
    assert book.take(book.vehicle.beat(), B, 0.1) == 1
    assert book.of.conflicts() == {}


def test_an_address_without_a_port_is_written_without() -> None:
    assert str(Address("/dev/ttyUSB0", 0, 0)) == "/dev/ttyUSB0"


@pytest.mark.parametrize("component", [COMPANION, GIMBAL, CAMERA, ADSB, 50])
@pytest.mark.parametrize("source", [A, B], ids=["same", "other"])
def test_a_component_received_first_shuts_out_no_autopilot(component: int, source: int) -> None:
    book, part = Book(), Sender(component=component)
    for time_s in (0.0, 0.1, 0.2):
        assert book.take(part.beat() + part.position(time_s), source, time_s) == 0
    assert all(count for _, count in book.fly(A, 0.3, 3.0))
    assert book.of.source[0] == A
    assert (book.counters.duplicates, book.counters.strangers, book.of.conflicts()) == (0, 0, {})


def test_components_beside_their_autopilot_are_no_duplicates() -> None:
    book, part = Book(), Sender(component=COMPANION)
    book.fly(A, 0.0, 1.0)
    assert book.take(part.beat(NONE), A, 1.0) == 1
    assert book.take(part.beat(NONE) + part.position(1.0), B, 1.0) == 0
    assert book.of.received_s[0] == pytest.approx(0.9)
    assert (book.counters.duplicates, book.of.conflicts()) == (0, {})


@pytest.mark.parametrize("source", [A, B], ids=["same", "other"])
def test_component_1_is_an_autopilot_by_its_heartbeat_only(source: int) -> None:
    book, other = Book(), Sender(number=77, boot_s=0.0)
    assert book.take(other.beat(NONE), source, 0.0) == 0
    assert book.take(other.position(0.1), source, 0.1) == 1
    assert book.take(book.vehicle.beat(), A, 0.2) == 1
    assert book.of.source[0] == A
    assert book.take(other.beat(NONE), source, 0.3) == 0
    assert book.of.received_s[0] == 0.2
    assert book.of.conflicts() == {}


@pytest.mark.parametrize(("system_id", "component"), [(51, RADIO), (3, RADIO), (3, 1)])
@pytest.mark.parametrize("source", [A, B], ids=["same", "other"])
def test_a_telemetry_radio_is_no_vehicle(system_id: int, component: int, source: int) -> None:
    book, radio = Book(), Sender(system_id, component)
    book.take(radio.radio(), source, 0.0)
    assert book.of.address(0) is None
    assert all(count for _, count in book.fly(A, 0.1, 1.0))
    book.take(radio.radio(), source, 1.0)
    assert book.of.received_s[0] == pytest.approx(0.9)
    assert (book.of.without_autopilot(), book.of.conflicts()) == ({}, {})


def test_components_without_an_autopilot_are_named() -> None:
    book = Book()
    book.take(Sender(component=50).beat(), A, 0.0)
    book.take(Sender(component=GIMBAL).beat(NONE), A, 0.1)
    book.take(Sender(4, COMPANION).beat(NONE), A, 0.1)
    assert book.of.without_autopilot() == {0: (50, True), 1: (COMPANION, False)}
    book.fly(A, 0.2, 0.5)
    assert book.of.without_autopilot() == {1: (COMPANION, False)}
    book.now_s = 0.2 + SILENT_AFTER_S
    assert book.of.without_autopilot() == {}


def moved_s(taken: list[tuple[float, int]]) -> float:
    """Time until frames are accepted, and then all of them are."""
    first = next(at for at, (_, count) in enumerate(taken) if count)
    assert all(count for _, count in taken[first:])
    return taken[first][0] - taken[0][0]


@pytest.mark.parametrize("silent_s", [0.0, 0.5, 1.5, 2.5])
@pytest.mark.parametrize("missing", [0, 3])
def test_an_address_moves_where_clock_and_sequence_go_on(silent_s: float, missing: int) -> None:
    book = Book()
    book.fly(A, 0.0, 5.0)
    begin_s = 5.0 + silent_s
    book.vehicle.packer.seq = (book.vehicle.packer.seq + round(22 * silent_s) + missing) % 256
    assert moved_s(book.fly(B, begin_s, begin_s + 1.0)) <= 2.0 * PERIOD_S + 1e-6
    assert book.of.source[0] == B
    assert (book.counters.duplicates, book.of.conflicts()) == (0, {})


def test_an_address_moves_twenty_times_in_twenty_seconds() -> None:
    book = Book()
    book.fly(A, 0.0, 5.0)
    for number in range(1, 21):
        taken = book.fly(A + number, 4.0 + number, 5.0 + number)
        assert moved_s(taken) <= 2.0 * PERIOD_S + 1e-6
        assert book.of.source[0] == A + number
    assert (book.counters.duplicates, book.of.conflicts()) == (0, {})


def test_an_address_that_still_sends_does_not_move() -> None:
    book = Book()
    book.fly(A, 0.0, 5.0)
    ahead = Sender(number=book.vehicle.packer.seq + 4)
    for step in range(50, 80):
        time_s = step * PERIOD_S
        assert book.take(book.vehicle.position(time_s), A, time_s) == 1
        assert book.take(ahead.position(time_s), B, time_s) == 0
    assert book.of.source[0] == A
    assert book.of.conflicts() == {0: TEXT}
    assert not any(count for _, count in book.fly(B, 8.0, 7.9 + SILENT_AFTER_S, ahead))


@pytest.mark.parametrize(("boot_s", "ahead"), [(-98.5, 1), (-50.0, 1), (-100.0, 128), (-100.0, 250)])
def test_another_clock_or_sequence_is_another_vehicle(boot_s: float, ahead: int) -> None:
    book = Book()
    book.fly(A, 0.0, 5.0)
    other = Sender(boot_s=boot_s, number=(book.vehicle.packer.seq + ahead - 1) % 256)
    assert not any(count for _, count in book.fly(B, 5.0, 4.9 + SILENT_AFTER_S, other))
    assert book.of.source[0] == A
    assert book.counters.duplicates >= UNLIKE_MAX
    assert set(book.of.conflicts()) == {0}


@pytest.mark.parametrize("late_s", [0.3, 2.0, 10.0])
def test_a_late_datagram_before_the_change_does_no_harm(late_s: float) -> None:
    book = Book()
    book.fly(A, 0.0, 5.0)
    late = Sender(number=(book.vehicle.packer.seq - round(22 * late_s)) % 256)
    assert book.take(late.position(5.0 - late_s), A, 5.0) == 1
    assert moved_s(book.fly(B, 5.1, 6.0)) <= 3.0 * PERIOD_S
    assert book.of.conflicts() == {}


def test_what_was_on_its_way_when_it_moved_is_dropped_unreported() -> None:
    book = Book()
    book.fly(A, 0.0, 5.0)
    number = book.vehicle.packer.seq
    book.fly(B, 5.0, 5.5)
    late = Sender(number=number - 3)
    assert [book.take(late.position(4.8), A, 5.3 + step * 0.1) for step in range(4)] == [0] * 4
    assert (book.counters.duplicates, book.of.conflicts()) == (0, {})
    assert moved_s(book.fly(A, 5.5, 6.5)) <= 2.0 * PERIOD_S + 1e-6


def test_a_restarted_autopilot_is_followed_by_its_new_clock() -> None:
    book = Book()
    book.fly(A, 0.0, 5.0)
    restarted = Sender(boot_s=5.0)
    book.fly(A, 5.0, 5.2 + STRAYS_S + BOTH_S, restarted)
    assert moved_s(book.fly(B, 5.2 + STRAYS_S + BOTH_S, 9.0, restarted)) <= 2.0 * PERIOD_S + 1e-6
    assert book.of.conflicts() == {}


def test_without_a_boot_clock_an_address_is_kept_to_the_end() -> None:
    book = Book()
    book.take(book.vehicle.beat(), A, 0.0)
    assert book.take(book.vehicle.beat(), B, SILENT_MAX_S) == 0
    assert book.take(book.vehicle.beat(), B, SILENT_AFTER_S) == 0
    assert book.take(book.vehicle.beat(), B, SILENT_AFTER_S + 0.1) == 1


def test_frames_of_one_sender_are_judged_once_and_all_counted() -> None:
    """Systems 3 and 4, and one that is not configured, a thousand frames each from one strange address."""
    book, (three, four, five) = Book(), (Sender(number) for number in (3, 4, 5))
    book.fly(A, 0.0, 1.0)
    for _ in range(UNLIKE_MAX):
        book.take(three.position(-50.0), B, 1.0)
    before = book.counters.duplicates
    flood = b"".join(one.position(-50.0) for _ in range(1000) for one in (three, four, five))
    assert book.take(flood, B, 1.1) == 1000, "4 has connected there"
    assert (book.counters.duplicates - before, book.counters.strangers) == (1000, 1000)
    assert lines_run(lambda: book.take(flood, B, 1.2)) < 500


def test_no_more_senders_are_judged_than_a_bound(caplog: pytest.LogCaptureFixture) -> None:
    other = Sender(boot_s=-500.0)
    raw = other.position(1.0)
    lines = []
    for many in (JUDGED_MAX, 20 * JUDGED_MAX):
        book = Book()
        book.fly(A, 0.0, 1.0)
        data, start = np.frombuffer(bytearray(raw * many), np.uint8), np.arange(many) * len(raw)
        length = np.full(many, len(raw))
        flood = Datagrams(data, start, length, B + 1 + np.arange(many), np.full(many, 1.1))
        frames = find(data, start, length).frames
        caplog.clear()
        lines.append(lines_run(partial(book.of.judge, frames, flood)))
        assert book.counters.duplicates == many
        assert caplog.messages.count("duplicate_system_id") == 1
    assert lines[1] < 1.2 * lines[0]
