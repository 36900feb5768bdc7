from gcs.links.address_book import CONFLICT_KEPT_S, SILENT_AFTER_S, AddressBook, Verdict
from gcs.links.link import Address

A = Address("127.0.0.1", 14582, 0)
B = Address("127.0.0.1", 14599, 0)
TEXT = "system id 3 at 127.0.0.1:14582 and at 127.0.0.1:14599"


def test_vehicle_is_reached_at_its_latest_address() -> None:
    address_book = AddressBook([3])
    assert address_book.address(3) is None
    assert address_book.receive(3, A, 0.0) is Verdict.FIRST
    assert address_book.receive(3, A, 0.1) is Verdict.KNOWN
    assert address_book.address(3) == A


def test_system_id_not_configured_is_unknown() -> None:
    address_book = AddressBook([3])
    assert address_book.receive(255, A, 0.0) is Verdict.STRANGER
    assert address_book.address(255) is None


def test_a_duplicate_is_refused_and_both_addresses_are_named() -> None:
    address_book = AddressBook([3])
    address_book.receive(3, A, 0.0)
    assert address_book.receive(3, B, 1.0) is Verdict.NEW_DUPLICATE
    assert address_book.receive(3, B, 1.1) is Verdict.DUPLICATE
    assert address_book.address(3) == A
    assert address_book.conflicts(1.1) == {3: TEXT}


def test_a_conflict_ends_when_the_duplicate_has_been_silent() -> None:
    address_book = AddressBook([3])
    address_book.receive(3, A, 0.0)
    address_book.receive(3, B, 1.0)
    assert address_book.conflicts(1.0 + CONFLICT_KEPT_S) == {3: TEXT}
    assert address_book.conflicts(1.1 + CONFLICT_KEPT_S) == {}
    address_book.receive(3, A, 8.0)
    assert address_book.receive(3, B, 8.5) is Verdict.NEW_DUPLICATE


def test_silent_vehicle_may_return_from_another_address() -> None:
    address_book = AddressBook([3])
    address_book.receive(3, A, 0.0)
    assert address_book.receive(3, B, SILENT_AFTER_S) is Verdict.NEW_DUPLICATE
    assert address_book.receive(3, B, SILENT_AFTER_S + 0.1) is Verdict.MOVED
    assert address_book.address(3) == B
    assert address_book.conflicts(SILENT_AFTER_S + 0.1) == {}


def test_address_that_is_gone_frees_its_system_ids() -> None:
    address_book = AddressBook([3, 4])
    address_book.receive(3, A, 0.0)
    address_book.receive(4, B, 0.0)
    address_book.forget(A)
    assert (address_book.address(3), address_book.address(4)) == (None, B)
    assert address_book.receive(3, B, 0.1) is Verdict.FIRST
    assert address_book.conflicts(0.1) == {}


def test_an_address_without_a_port_is_written_without() -> None:
    assert str(Address("/dev/ttyUSB0", 0, 0)) == "/dev/ttyUSB0"
