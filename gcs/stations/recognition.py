"""Which bytes can be a message between stations, by their beginnings: a flood of junk costs little.

Of each topic the bus keeps the newest message only: junk must not take the place of a valid one. Bytes that
are made to look valid are not recognised here: against these the bus has certificates.
"""

from typing import Final

from gcs.stations.messages import FORMATION, HOMES, SLOTS, STATES, VELOCITIES, VERSION
from gcs.stations.return_messages import RETURN

_KINDS: Final = {
    "states": STATES,
    "formation": FORMATION,
    "homes": HOMES,
    "slots": SLOTS,
    "velocities": VELOCITIES,
    "return": RETURN,
}
"""By the first word of a topic."""

_SITE_AT: Final = {STATES: 8, FORMATION: 2, SLOTS: 2, VELOCITIES: 2}
"""Place of the site's number in a message."""

_WRITTEN: Final = frozenset({"plan", "show", "parts", "info", "letters"})
"""Topics of JSON objects."""


def may_be_valid(topic: str, payload: bytes, site: int) -> bool:
    """Whether the bytes begin as a message of that topic, and of that site."""
    word = topic.partition(".")[0]
    if word in _WRITTEN:
        return payload[:1] == b"{" and payload[-1:] == b"}"
    kind = _KINDS.get(word)
    if kind is None or payload[:2] != bytes([VERSION, kind]):
        return False
    at = _SITE_AT.get(kind)
    return at is None or payload[at : at + 4] == site.to_bytes(4, "little")
