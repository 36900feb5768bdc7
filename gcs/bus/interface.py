"""What a bus offers a station. Newest wins, nothing queues, and nothing here waits."""

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol, TypeAlias

from gcs.links.intake import Intake
from gcs.model.errors import LinkError

log = logging.getLogger(__name__)

PAYLOAD_MAX: Final = 60_000
"""Bytes of one message: with its key it stays below one batch of the transport."""

CONNECTION_S: Final = 1.0
"""A connection over a cut bus, or to a station that hangs, stays for so long; that of a process that ends
closes at once.
"""


class Received(NamedTuple):
    """The newest message of one topic of another station."""

    sender: str
    topic: str
    payload: bytes
    time_s: float  # of its arrival or, where the bus cannot tell, of its collection; the loop's clock


Accepts: TypeAlias = Callable[[str, bytes], bool]
"""Whether the bytes of a topic can be a message of this site."""


def anything(_topic: str, _payload: bytes) -> bool:
    """Accept every message."""
    return True


@dataclass(slots=True)
class BusCounters:
    """Totals since the bus was created."""

    sent: int = 0  # messages, each with its topic
    received: int = 0
    sent_bytes: int = 0
    refused: int = 0  # too large, or not accepted


class Bus(Protocol):
    """Messages between stations. Used on the event loop's thread only.

    Messages may be lost, but those of one station keep their order. What must arrive is published again until
    its effect is received.
    """

    station: str
    counters: BusCounters
    accepts: Accepts  # what it does not accept takes no other message's place

    async def run(self) -> None:
        """Keep the bus open until it is cancelled. Raises: LinkError when it cannot be opened."""

    def publish(self, messages: Mapping[str, bytes]) -> None:
        """Send payloads by topic to all other stations; nothing happens while the bus is closed.

        Raises: LinkError when one has more than `PAYLOAD_MAX` bytes; none is sent then.
        """

    def newest(self) -> list[Received]:
        """What arrived since the last call: of each topic of each station the newest message only."""

    @property
    def present(self) -> frozenset[str]:
        """Other stations that are connected, as far as the transport knows."""

    @property
    def intakes(self) -> Sequence[Intake]:
        """What bounds those that are no stations; its clock is the loop's."""


RETRY_S: Final = 1.0


async def keep_bus_open(bus: Bus) -> None:
    """Run a bus without end; when it cannot be opened, log it once and try again."""
    failed = ""
    while True:
        try:
            await bus.run()
        except LinkError as error:
            if str(error) != failed:
                failed = str(error)
                log.error("bus_failed", extra={"cause": failed})
        await asyncio.sleep(RETRY_S)
