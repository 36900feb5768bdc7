"""After a kill, no command given before it may reach the vehicle."""

from collections.abc import Iterable


class KillLatch:
    """One latch per system: shut by a kill, opened only by a command given after it.

    MAVSDK repeats an unanswered command for 2 s. An arm command repeated after the kill would start the
    motors again, so while the latch is shut the link drops commands and setpoints for that system.
    Any thread may call anything: each method reads or writes single values of a dictionary whose keys never
    change, and a command that lost the race leaves the latch shut.
    """

    def __init__(self, system_ids: Iterable[int]) -> None:
        self._kills = dict.fromkeys(system_ids, 0)
        self._redeemed = dict(self._kills)

    def shut(self, system_id: int) -> None:
        """Record a kill command. One thread at a time."""
        self._kills[system_id] += 1

    def ticket(self, system_id: int) -> int:
        """To be taken when a command is given, and redeemed when it is executed."""
        return self._kills[system_id]

    def redeem(self, system_id: int, ticket: int) -> bool:
        """Open the latch for a command; False, and still shut, when a kill came after the command."""
        self._redeemed[system_id] = ticket
        return ticket == self._kills[system_id]

    def is_shut(self, system_id: int) -> bool:
        """Whether commands and setpoints for this system are to be dropped."""
        return self._redeemed.get(system_id) != self._kills.get(system_id)
