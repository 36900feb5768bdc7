"""Which vehicles may be sent setpoints right now; the answer expires by itself."""

from collections.abc import Iterable
from math import inf


class Deadman:
    """Permission that must be renewed: without a fresh tick, every setpoint is forbidden.

    One thread refreshes, any thread asks: the permission is one immutable pair, published by one assignment.
    """

    def __init__(self, hold_s: float) -> None:
        """Nothing is allowed before the first refresh; `hold_s` is how long each one lasts."""
        self._hold_s = hold_s
        self._permission: tuple[frozenset[int], float] = (frozenset(), -inf)

    def refresh(self, system_ids: Iterable[int], now_s: float) -> None:
        """Allow exactly these systems until `now_s` + hold, and forbid all others at once.

        System 0 is everybody, and never allowed.
        """
        self._permission = (frozenset(system_ids) - {0}, now_s + self._hold_s)

    def allows(self, system_id: int, now_s: float) -> bool:
        """Whether a setpoint to this system may leave at `now_s`."""
        system_ids, until_s = self._permission
        return now_s <= until_s and system_id in system_ids
