"""MIDI timecode: quarter frames and full frames, out of any stream of MIDI bytes. Pure.

Source: MIDI 1.0 Detailed Specification, "MIDI Time Code".
"""

from dataclasses import dataclass, field
from typing import Final

from gcs.shows.timecode.smpte import Label, Rate, Reading

QUARTER_FRAME: Final = 0xF1
SYSEX, SYSEX_END = 0xF0, 0xF7
SYSEX_MAX: Final = 32
"""A full frame has 8 bytes between its first and its last; the rest of longer messages is passed over."""

PIECES: Final = 8
BEHIND_FRAMES: Final = 2
"""Eight quarter frames carry the label of the first one, and take two frames."""

_REAL_TIME: Final = 0xF8
_DATA: Final = {0xF1: 1, 0xF2: 2, 0xF3: 1}


@dataclass(slots=True)
class MidiTimecode:
    """Reads timecode out of MIDI bytes; all other messages are passed over.

    Attributes:
        garbage: timecode messages that make no sense.
    """

    garbage: int = 0
    _status: int = 0  # of a message that is not complete yet; 0: none
    _data: list[int] = field(default_factory=list)
    _pieces: list[int] = field(default_factory=list)  # of the label that arrives, from piece 0
    _begins: tuple[float, Rate] | None = None  # time of the newest whole label, of the eight pieces before

    def take(self, data: bytes) -> list[Reading]:
        """The readings that `data` completes. Never raises, and keeps at most one message that is not."""
        readings: list[Reading] = []
        for byte in data:
            if byte >= _REAL_TIME:
                continue  # may come between the bytes of any message
            if byte & 0x80:
                if byte == SYSEX_END and self._status == SYSEX:
                    self._full_frame(readings)
                self._status, self._data = (byte if byte == SYSEX or byte in _DATA else 0), []
            elif self._status:
                self._byte(byte, readings)
        return readings

    def _byte(self, byte: int, readings: list[Reading]) -> None:
        if len(self._data) < SYSEX_MAX:
            self._data.append(byte)
        if self._status == SYSEX or len(self._data) < _DATA[self._status]:
            return
        if self._status == QUARTER_FRAME:
            self._quarter_frame(byte, readings)
        self._status = 0

    def _quarter_frame(self, byte: int, readings: list[Reading]) -> None:
        piece, value = byte >> 4, byte & 0x0F
        if piece != len(self._pieces) % PIECES:
            self.garbage += bool(self._pieces)  # one was lost, or it runs backwards
            self._pieces, self._begins = [], None
            if piece != 0:
                return
        if piece == 0:
            self._pieces = []
        self._pieces.append(value)
        if self._begins is not None:
            time_s, rate = self._begins
            behind = BEHIND_FRAMES + piece / 4
            readings.append(Reading(time_s + behind / rate.per_s, rate))
        if piece == PIECES - 1:
            self._label()

    def _label(self) -> None:
        """Take the label of eight pieces."""
        frames, seconds, minutes, hours = (
            low | high << 4 for low, high in zip(self._pieces[::2], self._pieces[1::2], strict=True)
        )
        label, rate = Label(hours & 0x1F, minutes, seconds, frames), Rate(hours >> 5 & 3)
        self._begins = (label.time_s(rate), rate) if label.exists(rate) else None
        self.garbage += self._begins is None

    def _full_frame(self, readings: list[Reading]) -> None:
        """Take F0 7F device 01 01 hours minutes seconds frames F7: where the source was brought to."""
        data = self._data
        if len(data) != 8 or data[0] != 0x7F or data[2:4] != [1, 1]:
            return
        label, rate = Label(data[4] & 0x1F, *data[5:8]), Rate(data[4] >> 5 & 3)
        self._pieces, self._begins = [], None
        if label.exists(rate):
            readings.append(Reading(label.time_s(rate), rate, runs=False))
        else:
            self.garbage += 1


def quarter_frames(label: Label, rate: Rate) -> list[bytes]:
    """The eight messages that carry a label, in order; a quarter of a frame lies between two of them."""
    values = label.frames, label.seconds, label.minutes, label.hours | rate.midi << 5
    nibbles = [part for value in values for part in (value & 0x0F, value >> 4)]
    return [bytes((QUARTER_FRAME, piece << 4 | value)) for piece, value in enumerate(nibbles)]
