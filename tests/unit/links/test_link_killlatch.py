from gcs.links.command_protocol import KillLatch


def test_the_latch_is_open_until_a_kill() -> None:
    latch = KillLatch([1, 2])
    latch.shut(1)
    assert latch.is_shut(1)
    assert not latch.is_shut(2)
    assert not latch.is_shut(0)
    assert not latch.is_shut(99)


def test_only_a_command_after_the_kill_opens_it() -> None:
    latch = KillLatch([1])
    before = latch.ticket(1)
    latch.shut(1)
    assert not latch.redeem(1, before)
    assert latch.is_shut(1)
    assert latch.redeem(1, latch.ticket(1))
    assert not latch.is_shut(1)


def test_kill_between_redeeming_and_sending_still_closes() -> None:
    latch = KillLatch([1])
    assert latch.redeem(1, latch.ticket(1))
    latch.shut(1)
    assert latch.is_shut(1)
