"""The messages of one tick as one: a transport's work is for each message, more than for its bytes.

A bundle holds parts: u8 length of the topic, topic in UTF-8, u32 length of the payload, payload.
"""

from collections.abc import Iterator, Mapping
from typing import Final

from gcs.bus.interface import PAYLOAD_MAX
from gcs.model.errors import LinkError

TOPIC_MAX: Final = 255
"""Bytes of a topic."""

PARTS_MAX: Final = 64
"""Of one bundle."""

BUNDLE_MAX: Final = PAYLOAD_MAX + TOPIC_MAX + 5
"""Bytes of one bundle: the longest message fits in."""


def bundles(messages: Mapping[str, bytes]) -> Iterator[bytes]:
    """Return messages by topic as few bundles, in this order. Raises: LinkError for one that is too long."""
    parts: list[bytes] = []
    for topic, payload in messages.items():
        name = topic.encode()
        if len(payload) > PAYLOAD_MAX or len(name) > TOPIC_MAX:
            raise LinkError(f"{topic}: {len(payload)} bytes where {PAYLOAD_MAX} are possible")
        parts.append(b"".join((bytes([len(name)]), name, len(payload).to_bytes(4, "little"), payload)))
    begin, size = 0, 0
    for end, part in enumerate(parts):
        if end - begin == PARTS_MAX or size + len(part) > BUNDLE_MAX:
            yield b"".join(parts[begin:end])
            begin, size = end, 0
        size += len(part)
    if parts:
        yield b"".join(parts[begin:])


def parts_of(bundle: bytes) -> list[tuple[str, bytes]]:
    """Return topics and payloads of a bundle. Raises: LinkError for bytes that are none."""
    parts: list[tuple[str, bytes]] = []
    at, end = 0, len(bundle)
    while at < end:
        if end > BUNDLE_MAX or len(parts) == PARTS_MAX:
            raise LinkError("a bundle that is too large")
        payload_at = at + 5 + bundle[at]
        next_at = payload_at + int.from_bytes(bundle[payload_at - 4 : payload_at], "little")
        if next_at > end or payload_at > end:
            raise LinkError("a bundle that ends within a message")
        try:
            topic = bundle[at + 1 : payload_at - 4].decode()
        except UnicodeDecodeError:
            raise LinkError("a bundle with a topic that is no text") from None
        parts.append((topic, bundle[payload_at:next_at]))
        at = next_at
    return parts
