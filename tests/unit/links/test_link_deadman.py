from math import nan

from gcs.links.deadman import Deadman


def test_nothing_is_allowed_before_the_first_tick() -> None:
    assert not Deadman(0.2).allows(1, 0.0)


def test_a_listed_vehicle_is_allowed_for_the_hold_time_only() -> None:
    deadman = Deadman(0.2)
    deadman.refresh([1, 2], 10.0)
    assert deadman.allows(1, 10.0)
    assert deadman.allows(2, 10.2)
    assert not deadman.allows(2, 10.2001)


def test_a_vehicle_no_longer_listed_is_forbidden_at_once() -> None:
    deadman = Deadman(0.2)
    deadman.refresh([1, 2], 10.0)
    deadman.refresh([2], 10.05)
    assert not deadman.allows(1, 10.05)
    assert deadman.allows(2, 10.25)


def test_everybody_is_never_allowed() -> None:
    deadman = Deadman(0.2)
    deadman.refresh([0, 1], 10.0)
    assert not deadman.allows(0, 10.0)


def test_a_time_that_is_no_number_allows_nothing() -> None:
    deadman = Deadman(0.2)
    deadman.refresh([1], nan)
    assert not deadman.allows(1, 10.0)
