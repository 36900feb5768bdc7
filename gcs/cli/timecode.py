"""`gcs timecode`: reads linear timecode from sound; prints it, or sends it on as MIDI timecode."""

import argparse
import os
import select
import socket
import sys
import time
import wave
from collections.abc import Iterator
from dataclasses import dataclass
from math import isnan
from typing import Final

import numpy as np

from gcs.cli.output import answer
from gcs.model.errors import InvalidError, UnknownError
from gcs.shows.timecode import Chase, Rate, Reading
from gcs.shows.timecode.ltc import LinearTimecode
from gcs.shows.timecode.midi import PIECES, quarter_frames
from gcs.shows.timecode.smpte import label_at

BLOCK_BYTES: Final = 65536
FULL_SCALE: Final = 32768.0
SHOWN_EVERY_S: Final = 1.0
FREEWHEEL_S: Final = 1.0
WAITS_S: Final = 0.1
CHANNELS_MAX: Final = 64


def add_timecode_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file", nargs="?", default="-", help="a WAV file; - (default): samples of 16 bits from standard input"
    )
    parser.add_argument("--samples-per-s", type=int, default=48_000, help="of standard input (48000)")
    parser.add_argument("--channels", type=int, default=1, help="of standard input (1)")
    parser.add_argument("--channel", type=int, default=1, help="the one with the timecode (1)")
    parser.add_argument("--to", metavar="IP:PORT", help="send it on, as MIDI timecode over UDP")
    parser.epilog = (
        "arecord -t raw -f S16_LE -r 48000 -c 1 --period-size=480 | gcs timecode --to 127.0.0.1:5006"
        " for a service with timecode: {source: 'udp-midi://127.0.0.1:5006'}"
    )


def run_timecode(arguments: argparse.Namespace) -> int:
    """Read until the sound ends. Returns: 0 if there was timecode, otherwise 1."""
    out = None if arguments.to is None else QuarterFrames(_address(arguments.to))
    if arguments.file != "-":
        if out is not None:
            raise InvalidError("to", arguments.to, "with sound from standard input: a file is no clock")
        return _print_file(arguments)
    sound = Sound(arguments.samples_per_s, arguments.channels, arguments.channel)
    return _follow(arguments, sound, out)


@dataclass(slots=True)
class Sound:
    """Cuts one channel out of interleaved samples, and reads it.

    Raises: InvalidError for a channel that is not there, or a rate that cannot be.
    """

    samples_per_s: int
    channels: int
    channel: int
    _rest: bytes = b""
    _linear: LinearTimecode | None = None

    def __post_init__(self) -> None:
        if not 8_000 <= self.samples_per_s <= 192_000:
            raise InvalidError("samples-per-s", self.samples_per_s, "from 8000 to 192000")
        if not 1 <= self.channels <= CHANNELS_MAX:
            raise InvalidError("channels", self.channels, f"from 1 to {CHANNELS_MAX}")
        if not 1 <= self.channel <= self.channels:
            raise InvalidError("channel", self.channel, f"from 1 to {self.channels}")
        self._linear = LinearTimecode(float(self.samples_per_s))

    def take(self, data: bytes) -> list[Reading]:
        """The readings that these bytes complete."""
        data, size = self._rest + data, 2 * self.channels
        whole = len(data) - len(data) % size
        self._rest = data[whole:]
        samples = np.frombuffer(data[:whole], "<i2").reshape(-1, self.channels)[:, self.channel - 1]
        return [] if self._linear is None else self._linear.take(samples / FULL_SCALE)


def _print_file(arguments: argparse.Namespace) -> int:
    try:
        with wave.open(arguments.file, "rb") as file:
            if file.getsampwidth() != 2:
                raise InvalidError("file", arguments.file, "of 16 bits a sample")
            sound = Sound(file.getframerate(), file.getnchannels(), arguments.channel)
            return _print_all(arguments, _blocks(file), sound)
    except (OSError, EOFError, wave.Error) as error:
        raise UnknownError(f"{arguments.file}: {str(error) or 'it ends too early'}") from None


def _blocks(file: wave.Wave_read) -> Iterator[bytes]:
    while data := file.readframes(BLOCK_BYTES // (2 * file.getnchannels())):
        yield data


def _print_all(arguments: argparse.Namespace, blocks: Iterator[bytes], sound: Sound) -> int:
    """Print one line for each second of timecode."""
    shown_s, count = float("nan"), 0
    for data in blocks:
        for reading in sound.take(data):
            count += 1
            if isnan(shown_s) or not 0.0 <= reading.time_s - shown_s < SHOWN_EVERY_S:
                shown_s = reading.time_s
                _print(arguments, reading.time_s, reading.rate, None)
    return 0 if count else 1


def _print(arguments: argparse.Namespace, time_s: float, rate: Rate, slope: float | None) -> None:
    label = str(label_at(time_s, rate))
    off = "" if slope is None else f"  {1e6 * (slope - 1.0):+.0f} ppm"
    document = {"label": label, "frame_rate": rate.text, "time_s": round(time_s, 4), "slope": slope}
    answer(arguments, document, f"{label}  {rate.text} frames/s{off}", indent=None)


def _follow(arguments: argparse.Namespace, sound: Sound, out: "QuarterFrames | None") -> int:
    """Read sound as it is played; print each second where the timecode is, and send it on."""
    chase, shown_s, found = Chase(FREEWHEEL_S, jump_max_s=FREEWHEEL_S), 0.0, False
    source = sys.stdin.fileno()
    while True:
        now_s = time.monotonic()
        wait_s = WAITS_S if out is None else min(max(out.send_due(chase, now_s), 0.0), WAITS_S)
        if select.select([source], [], [], wait_s)[0]:
            data = os.read(source, BLOCK_BYTES)
            if not data:
                return 0 if found else 1
            now_s = time.monotonic()
            for reading in sound.take(data):
                chase.take(reading, now_s)
                found = True
        if chase.rate is not None and chase.runs(now_s) and now_s - shown_s >= SHOWN_EVERY_S:
            shown_s = now_s
            _print(arguments, chase.time_s(now_s), chase.rate, round(chase.slope(), 6))


class QuarterFrames:
    """Sends MIDI timecode, each message when it is due."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._address = address
        self._next: int | None = None  # number of the next message, from 00:00:00:00; None: it does not run

    def send_due(self, chase: Chase, now_s: float) -> float:
        """Send what is due. Returns: the time until the next, in s."""
        rate = chase.rate
        if rate is None or not chase.runs(now_s):
            self._next = None
            return WAITS_S
        per_s = 4.0 * rate.per_s
        at = chase.time_s(now_s) * per_s
        if self._next is None or not -PIECES < at - self._next < PIECES:  # from the next whole label on
            self._next = (int(at) // PIECES + 1) * PIECES
        while self._next <= at:
            number, piece = divmod(self._next, PIECES)
            label = label_at((2 * number + 0.5) / rate.per_s, rate)
            self._socket.sendto(quarter_frames(label, rate)[piece], self._address)
            self._next += 1
        return (self._next - at) / per_s


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise InvalidError("to", text, "IP:PORT")
    return host, int(port)
