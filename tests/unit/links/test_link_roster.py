from gcs.links.address_book import CONFLICT_KEPT_S, SILENT_AFTER_S, Address, Roster, Verdict

A = Address("127.0.0.1", 14582, 0)
B = Address("127.0.0.1", 14599, 0)
TEXT = "system id 3 at 127.0.0.1:14582 and at 127.0.0.1:14599"


def test_a_vehicle_is_reached_where_it_was_received_last() -> None:
    roster = Roster([3])
    assert roster.address(3) is None
    assert roster.hear(3, A, 0.0) is Verdict.FIRST
    assert roster.hear(3, A, 0.1) is Verdict.KNOWN
    assert roster.address(3) == A


def test_a_system_not_configured_is_a_stranger() -> None:
    roster = Roster([3])
    assert roster.hear(255, A, 0.0) is Verdict.STRANGER
    assert roster.address(255) is None
    assert roster.everybody == ()


def test_several_vehicles_behind_one_address_are_one_destination() -> None:
    roster = Roster([3, 4])
    roster.hear(3, A, 0.0)
    roster.hear(4, A, 0.0)
    assert roster.everybody == (A,)


def test_a_duplicate_is_refused_and_both_addresses_are_named() -> None:
    roster = Roster([3])
    roster.hear(3, A, 0.0)
    assert roster.hear(3, B, 1.0) is Verdict.NEW_DUPLICATE
    assert roster.hear(3, B, 1.1) is Verdict.DUPLICATE
    assert roster.address(3) == A
    assert roster.conflicts(1.1) == {3: TEXT}


def test_a_conflict_ends_when_the_duplicate_has_been_silent() -> None:
    roster = Roster([3])
    roster.hear(3, A, 0.0)
    roster.hear(3, B, 1.0)
    assert roster.conflicts(1.0 + CONFLICT_KEPT_S) == {3: TEXT}
    assert roster.conflicts(1.1 + CONFLICT_KEPT_S) == {}
    roster.hear(3, A, 8.0)
    assert roster.hear(3, B, 8.5) is Verdict.NEW_DUPLICATE


def test_a_vehicle_that_was_silent_may_come_back_from_elsewhere() -> None:
    roster = Roster([3])
    roster.hear(3, A, 0.0)
    assert roster.hear(3, B, SILENT_AFTER_S) is Verdict.NEW_DUPLICATE
    assert roster.hear(3, B, SILENT_AFTER_S + 0.1) is Verdict.MOVED
    assert roster.address(3) == B
    assert roster.everybody == (B,)
    assert roster.conflicts(SILENT_AFTER_S + 0.1) == {}


def test_an_address_that_is_gone_leaves_its_systems_free_to_come_back_from_anywhere() -> None:
    roster = Roster([3, 4])
    roster.hear(3, A, 0.0)
    roster.hear(4, B, 0.0)
    roster.forget(A)
    assert (roster.address(3), roster.everybody) == (None, (B,))
    assert roster.hear(3, B, 0.1) is Verdict.FIRST
    assert roster.conflicts(0.1) == {}


def test_an_address_without_a_port_is_written_without() -> None:
    assert str(Address("/dev/ttyUSB0", 0, 0)) == "/dev/ttyUSB0"
