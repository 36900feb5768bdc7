"""The interface of one socket or serial port."""

from collections.abc import Callable, Iterable
from selectors import BaseSelector
from typing import NamedTuple, Protocol, TypeAlias

from gcs.links.address_book import Address
from gcs.mavlink.framing import Split


class Arrival(NamedTuple):
    """Bytes that arrived from one address at one time."""

    address: Address
    parts: Split
    time_s: float


Read: TypeAlias = Callable[[float], Iterable[Arrival]]
"""Reads what has arrived, given the present time. Every file in the selector has one as its data.

The caller may stop iterating: the next call reads the rest.
"""


class Endpoint(Protocol):
    """One port to vehicles, which reconnects by itself. Never blocks.

    Everything is called on the loop's thread, except `send`, which any thread may call.
    """

    @property
    def standing(self) -> tuple[Address, ...]:
        """Far ends that can be sent to before they send anything. Safe on any thread."""
        ...

    def open(self, selector: BaseSelector, now_s: float) -> None:
        """Open the port. Raises: LinkError when that fails for another reason than a missing far end."""
        ...

    def close(self) -> None:
        """Close; it may be opened again."""
        ...

    def tend(self, now_s: float) -> None:
        """Reconnect, and continue frames sent in part. To be called about 50 times a second."""
        ...

    def gone(self) -> tuple[Address, ...]:
        """Addresses whose connection has ended since the last call."""
        ...

    def send(self, data: bytes, address: Address, *, perishable: bool) -> None:
        """Send one frame, whole or not at all.

        Args:
            data: the frame.
            address: one of this endpoint's.
            perishable: not worth sending if it would have to wait behind others.

        Raises: BlockingIOError when there is no room; OSError when there is no route.
        """
        ...
