"""Status texts of one vehicle, put together from their chunks."""

from dataclasses import dataclass, field
from math import inf
from typing import Final

from gcs.mavlink.framing import TextChunk
from gcs.model.state import StatusText

CHUNKS_MAX: Final = 8
TEXTS_KEPT: Final = 16
"""An ArduCopter that does not arm sends up to ten reasons at a time."""

REPEATED_S: Final = 10.0
"""A chunk that arrives again within this time is the same one, delivered twice."""


@dataclass(slots=True)
class _Text:
    """A text of which chunks have arrived."""

    text_id: int
    shown: StatusText
    began_s: float
    chunks: dict[int, bytes] = field(default_factory=dict)

    def is_part_of(self, text_id: int, time_s: float) -> bool:
        return self.text_id == text_id and time_s - self.began_s <= REPEATED_S


class StatusTexts:
    """The newest status texts of one vehicle. Texts longer than 50 bytes arrive in chunks.

    Attributes:
        text, text_time_s: the text of the newest chunk, and its arrival.
        texts: the newest few, the oldest first.
    """

    def __init__(self) -> None:
        self.text = ""
        self.text_time_s = -inf
        self.texts: tuple[StatusText, ...] = ()
        self._in_chunks: tuple[_Text, ...] = ()

    def take(self, chunk: TextChunk, time_s: float) -> None:
        """Read one STATUSTEXT, in any order and also twice; a missing chunk is left out of the text."""
        if chunk.text_id == 0:
            self._show(None, StatusText(time_s, chunk.severity, _read(chunk.text)))
            return
        if chunk.chunk >= CHUNKS_MAX:
            return
        text = next((each for each in self._in_chunks if each.is_part_of(chunk.text_id, time_s)), None)
        if text is not None and (received := text.chunks.get(chunk.chunk)) is not None:
            if received == chunk.text:
                return
            text = None  # the vehicle has restarted, and counts its texts anew
        before = None if text is None else text.shown
        chunks = {chunk.chunk: chunk.text} | ({} if text is None else text.chunks)
        shown = StatusText(time_s, chunk.severity, _read(b"".join(chunks[at] for at in sorted(chunks))))
        if text is None:
            text = _Text(chunk.text_id, shown, time_s)
            others = tuple(each for each in self._in_chunks if each.text_id != chunk.text_id)
            self._in_chunks = (*others, text)[-TEXTS_KEPT:]
        text.shown, text.chunks = shown, chunks
        self._show(before, shown)

    def forget(self, prefix: str) -> None:
        """Drop the texts that begin so: what they say is over."""
        self.texts = tuple(each for each in self.texts if not each.text.startswith(prefix))

    def _show(self, before: StatusText | None, now: StatusText) -> None:
        """Show a text, in the place of what was known of it before; a repeated one is shown once."""
        self.text, self.text_time_s = now.text, now.time_s
        if any(each is before for each in self.texts):
            self.texts = tuple(now if each is before else each for each in self.texts)
        else:
            others = [each for each in self.texts if each.text != now.text]
            self.texts = (*others, now)[-TEXTS_KEPT:]


def _read(text: bytes) -> str:
    return text.decode(errors="replace").strip()
