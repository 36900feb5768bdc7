"""Permission to send setpoints and heartbeats; every permission expires by itself."""

from collections.abc import Iterable, Mapping
from math import inf
from typing import Final

from gcs.model.errors import InvalidError

_SEND_MARGIN_S: Final = 0.02
"""Between the last reading of the clock and the datagram's leaving, other threads may hold the GIL."""


def before_it_leaves_s(setpoint_timeout_s: float) -> float:
    """Greatest age of a setpoint at its last check, so that it leaves within `setpoint_timeout_s`.

    Raises: InvalidError when no time is left.
    """
    if not setpoint_timeout_s > _SEND_MARGIN_S:
        raise InvalidError("setpoint_timeout_s", setpoint_timeout_s, f"above {_SEND_MARGIN_S} s")
    return setpoint_timeout_s - _SEND_MARGIN_S


class SetpointWatchdog:
    """Permission that must be renewed: without a fresh tick, every setpoint is forbidden.

    One thread refreshes, any thread asks: the permission is one immutable pair, published by one assignment.
    """

    def __init__(self, hold_s: float) -> None:
        """Nothing is allowed before the first refresh; `hold_s` is the duration of each permission."""
        self._hold_s = hold_s
        self._permission: tuple[frozenset[int], float] = (frozenset(), -inf)

    def refresh(self, system_ids: Iterable[int], now_s: float) -> None:
        """Allow exactly these systems until `now_s` + hold, and forbid all others at once.

        System 0 addresses all systems, and is never allowed.
        """
        self._permission = (frozenset(system_ids) - {0}, now_s + self._hold_s)

    def is_alive(self, now_s: float) -> bool:
        """Whether the permission, for any system, still holds at `now_s`."""
        return now_s <= self._permission[1]

    def allows(self, system_id: int, now_s: float) -> bool:
        """Whether a setpoint to this system may leave at `now_s`."""
        system_ids, until_s = self._permission
        return now_s <= until_s and system_id in system_ids


class ExpectedSetpoints:
    """The newest tick's setpoint of each vehicle: a setpoint with another velocity is an old one.

    MAVSDK has a queue and threads of its own. A thread that was stuck continues with what waited there, under
    the permission that a tick has renewed meanwhile. One thread replaces, any thread asks.
    """

    def __init__(self) -> None:
        """No setpoint is expected."""
        self._orders: Mapping[int, bytes] = {}

    def replace(self, setpoints: Mapping[int, bytes]) -> None:
        """By system id, as bytes of the frame; never to be changed afterwards."""
        self._orders = setpoints

    def is_newest(self, system_id: int, setpoint: bytes) -> bool:
        """Whether this is the newest tick's setpoint."""
        return self._orders.get(system_id) == setpoint


class HeartbeatGate:
    """Permission for our heartbeats: they mean that control runs; vehicles' failsafes wait for their end."""

    def __init__(self, hold_s: float) -> None:
        """No permission before the first beat; `hold_s` is the duration of each."""
        self._hold_s = hold_s
        self._until_s = -inf

    def beat(self, now_s: float) -> None:
        """Renew the permission: control is running."""
        self._until_s = now_s + self._hold_s

    def is_alive(self, now_s: float) -> bool:
        """Whether the last beat is recent enough."""
        return now_s <= self._until_s
