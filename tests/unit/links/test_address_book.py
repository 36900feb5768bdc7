import logging

import numpy as np
import pytest

from gcs.links.address_book import CONFLICT_KEPT_S, NOWHERE, Addresses
from gcs.links.endpoints.ports import Datagrams, host_number, source_of
from gcs.links.endpoints.streams import LinkPorts
from gcs.links.link import Address, Counters
from gcs.links.odd_frames import JUDGED_MAX
from gcs.mavlink.kernels import DATAGRAM, FRAME_COLUMNS, SYSTEM
from gcs.mavlink.reports import SILENT_AFTER_S
from tests.support.work import lines_run

A = source_of(host_number("127.0.0.1"), 14582, 0)
B = source_of(host_number("127.0.0.1"), 14599, 0)
TEXT = "system id 3 at 127.0.0.1:14582 and at 127.0.0.1:14599"


class Book:
    """Addresses of system ids 3 and 4 (rows 0 and 1), and their clock."""

    def __init__(self) -> None:
        self.now_s, self.counters = 0.0, Counters()
        self.of = Addresses(
            "test", (3, 4), LinkPorts("test", (), lambda: 0.0).address, self.counters, lambda: self.now_s
        )

    def receive(self, system_id: int, source: int, time_s: float) -> bool:
        self.now_s = time_s
        frames = np.zeros((1, FRAME_COLUMNS), np.int64)
        frames[0, SYSTEM] = system_id
        ones = np.ones(1, np.int64)
        arrived = Datagrams(np.zeros(1, np.uint8), ones, ones, np.array([source]), np.array([time_s]))
        return len(self.of.judge(frames, arrived)[0]) == 1


def test_vehicle_is_reached_at_its_latest_address() -> None:
    book = Book()
    assert book.of.address(0) is None
    assert book.receive(3, A, 0.0)
    assert book.receive(3, A, 0.1)
    assert book.of.address(0) == Address("127.0.0.1", 14582, 0)
    assert book.of.received_s.tolist() == [0.1, -np.inf]


def test_system_id_not_configured_is_unknown() -> None:
    book = Book()
    assert not book.receive(255, A, 0.0)
    assert book.counters.strangers == 1
    assert book.of.source.tolist() == [NOWHERE, NOWHERE]


def test_a_duplicate_is_refused_and_both_addresses_are_named() -> None:
    book = Book()
    assert book.receive(3, A, 0.0)
    assert not book.receive(3, B, 1.0)
    assert not book.receive(3, B, 1.1)
    assert book.of.source[0] == A
    assert book.of.conflicts() == {0: TEXT}
    assert book.counters.duplicates == 2


def test_a_conflict_ends_when_the_duplicate_has_been_silent() -> None:
    book = Book()
    book.receive(3, A, 0.0)
    book.receive(3, B, 1.0)
    book.now_s = 1.0 + CONFLICT_KEPT_S
    assert book.of.conflicts() == {0: TEXT}
    book.now_s += 0.1
    assert book.of.conflicts() == {}


def test_each_new_conflict_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    book = Book()
    caplog.set_level(logging.INFO)
    for source, time_s in ((A, 0.0), (B, 1.0), (B, 1.1), (A, 8.0), (B, 8.5)):
        book.receive(3, source, time_s)
    assert caplog.messages == ["vehicle_connected", "duplicate_system_id", "duplicate_system_id"]


def test_silent_vehicle_may_return_from_another_address() -> None:
    book = Book()
    book.receive(3, A, 0.0)
    assert not book.receive(3, B, SILENT_AFTER_S)
    assert book.receive(3, B, SILENT_AFTER_S + 0.1)
    assert book.of.source[0] == B
    assert book.of.conflicts() == {}


def test_address_that_is_gone_frees_its_system_ids() -> None:
    book = Book()
    book.receive(3, A, 0.0)
    book.receive(4, B, 0.0)
    book.of.forget([A])
    assert book.of.source.tolist() == [NOWHERE, B]
    assert book.receive(3, B, 0.1)
    assert book.of.conflicts() == {}


def test_an_address_without_a_port_is_written_without() -> None:
    assert str(Address("/dev/ttyUSB0", 0, 0)) == "/dev/ttyUSB0"


def test_frames_of_one_group_are_judged_once_and_all_counted() -> None:
    """Systems 3 and 4, and one that is not configured, a thousand frames each from one strange address."""
    book = Book()
    book.receive(3, A, 0.0)
    frames = np.zeros((3000, FRAME_COLUMNS), np.int64)
    frames[:, SYSTEM] = np.tile([3, 4, 5], 1000)
    ones = np.ones(1, np.int64)
    flood = Datagrams(np.zeros(1, np.uint8), ones, ones, np.array([B]), np.array([0.1]))
    accepted, rows, times_s = book.of.judge(frames, flood)
    assert (rows.tolist(), times_s.tolist()) == ([1] * 1000, [0.1] * 1000), "4 has connected there"
    assert len(accepted) == 1000
    assert (book.counters.duplicates, book.counters.strangers) == (1000, 1000)
    assert lines_run(lambda: book.of.judge(frames, flood)) < 200


def test_no_more_groups_are_judged_than_a_bound(caplog: pytest.LogCaptureFixture) -> None:
    book = Book()
    book.receive(3, A, 0.0)
    frames = np.zeros((1000, FRAME_COLUMNS), np.int64)
    frames[:, SYSTEM], frames[:, DATAGRAM] = 3, np.arange(1000)
    many = np.arange(1000)
    flood = Datagrams(np.zeros(1, np.uint8), many, many, B + 1 + many, np.full(1000, 0.1))
    assert lines_run(lambda: book.of.judge(frames, flood)) < 100 * JUDGED_MAX
    assert book.counters.duplicates == 1000
    assert caplog.messages.count("duplicate_system_id") == 1
