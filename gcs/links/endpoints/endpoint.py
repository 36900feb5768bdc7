"""The boundary to one socket or serial port."""

from collections.abc import Callable, Iterable
from selectors import BaseSelector
from typing import NamedTuple, Protocol, TypeAlias

from gcs.links.address_book import Address
from gcs.mavlink.framing import Split


class Arrival(NamedTuple):
    """What came from one place at one time."""

    address: Address
    parts: Split
    time_s: float


Read: TypeAlias = Callable[[float], Iterable[Arrival]]
"""Takes in what has arrived, given the time now. Every file in the selector has one for its data.

Whoever iterates may stop: the rest is taken in by the next call.
"""


class Endpoint(Protocol):
    """One way to vehicles, that comes back by itself. Never blocks.

    Everything is called on the loop's thread, except `send`, which any thread may call.
    """

    @property
    def standing(self) -> tuple[Address, ...]:
        """Far ends that may be spoken to before they are heard. Safe on any thread."""
        ...

    def open(self, selector: BaseSelector, now_s: float) -> None:
        """Begin. Raises: LinkError when it cannot be had, and not for want of the far end."""
        ...

    def close(self) -> None:
        """End; it may be opened again."""
        ...

    def tend(self, now_s: float) -> None:
        """Connect again, go on with what was left half sent. To be called 50 times a second or so."""
        ...

    def gone(self) -> tuple[Address, ...]:
        """Addresses that have ended since the last call: whoever spoke from there is not there any more."""
        ...

    def send(self, data: bytes, address: Address, *, perishable: bool) -> None:
        """Send one frame, whole or not at all.

        Args:
            data: the frame.
            address: one of this endpoint's.
            perishable: not worth sending where it would have to wait behind others.

        Raises: BlockingIOError when there is no room; OSError when there is no way.
        """
        ...
