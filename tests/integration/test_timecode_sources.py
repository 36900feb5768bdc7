"""Timecode over real sockets and pipes: MIDI over UDP and RTP, a MIDI port, sound; and `gcs timecode`."""

import asyncio
import fcntl
import json
import os
import socket
import struct
import subprocess
import sys
import termios
import time
import wave
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import pytest

from gcs.links.features import TimecodeSettings
from gcs.links.intake import Intake
from gcs.shows.timecode import Chase, Rate, Reading
from gcs.shows.timecode.receiver import MIDI, bound_of, keep_receiving
from gcs.shows.timecode.smpte import Label
from tests.support.machine import free_ports
from tests.support.started import run
from tests.support.timecode import INVITATION, SYNC, pcm, rtp, running, sound

START, RATE = Label(1, 0, 0, 0), Rate.FPS_25
SAMPLES_PER_S = 8000
SOON_S = 30.0


@dataclass
class Kept:
    """What a source sent."""

    readings: list[Reading] = field(default_factory=list)
    chase: Chase = field(default_factory=lambda: Chase(freewheel_s=5.0, jump_max_s=5.0))
    garbage: int = 0
    intake: Intake = field(default_factory=lambda: Intake("timecode", MIDI))
    failures: list[str] = field(default_factory=list)

    def take(self, reading: Reading, now_s: float) -> None:
        self.readings.append(reading)
        self.chase.take(reading, now_s)

    def count(self, garbage: int) -> None:
        self.garbage = garbage

    def failed(self, why: str) -> None:
        self.failures.append(why)

    async def until(self, holds: Callable[[], bool]) -> None:
        async with asyncio.timeout(SOON_S):
            while not holds():  # noqa: ASYNC110 (a list has no event)
                await asyncio.sleep(0.01)


def received(source: str, story: Callable[[Kept], Awaitable[None]]) -> Kept:
    """Receive while the story runs."""
    kept = Kept()

    async def main() -> None:
        settings = TimecodeSettings(source=source)
        kept.intake.bound = bound_of(settings)
        task = asyncio.create_task(keep_receiving(settings, kept, kept.intake))
        try:
            await asyncio.sleep(0.1)
            await story(kept)
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    asyncio.run(main())
    return kept


def send(outlet: socket.socket, data: bytes, port: int) -> None:
    outlet.sendto(data, ("127.0.0.1", port))


def test_midi_over_udp_is_received_and_a_flood_is_not_read() -> None:
    port = free_ports()

    async def story(kept: Kept) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
            for _, sent in zip(range(40), running(START, RATE), strict=False):
                send(outlet, sent.message, port)
            await kept.until(lambda: len(kept.readings) == 32)
            for _ in range(20):
                for _ in range(200):
                    send(outlet, os.urandom(40), port)
                await asyncio.sleep(0.01)
            await kept.until(lambda: kept.intake.dropped > 0)
            kept.intake.why_over(asyncio.get_running_loop().time()).index("messages a second from 127.0.0.1:")

    kept = received(f"udp-midi://127.0.0.1:{port}", story)
    assert kept.readings[0].rate is RATE
    assert kept.readings[0].time_s == pytest.approx(3600.0 + 2 / 25)
    assert not kept.failures


def test_a_session_over_rtp_is_joined_and_followed() -> None:
    port = free_ports(2)

    async def story(kept: Kept) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
            outlet.settimeout(SOON_S)
            for number in (port, port + 1):
                send(outlet, INVITATION, number)
                answer, _ = await asyncio.to_thread(outlet.recvfrom, 100)
                assert answer.startswith(b"\xff\xffOK")
            send(outlet, SYNC, port + 1)
            answer, _ = await asyncio.to_thread(outlet.recvfrom, 100)
            assert answer.startswith(b"\xff\xffCK")
            for number, sent in zip(range(40), running(START, RATE), strict=False):
                send(outlet, rtp([sent.message], number), port + 1)
            await kept.until(lambda: len(kept.readings) == 32)

    kept = received(f"rtp-midi://127.0.0.1:{port}", story)
    assert not kept.failures


def test_sound_is_read_from_a_pipe_whose_writer_comes_again(tmp_path: Path) -> None:
    pipe = tmp_path / "ltc"
    os.mkfifo(pipe)

    async def story(kept: Kept) -> None:
        for begin in (START, Label(1, 0, 1, 0)):
            kept.readings.clear()
            data = pcm(sound(begin, RATE, 1.0, SAMPLES_PER_S))
            with pipe.open("wb", buffering=0) as outlet:
                for at in range(0, len(data), 800):
                    outlet.write(data[at : at + 800])
                    await asyncio.sleep(0.05)
            await kept.until(lambda: len(kept.readings) >= 20)

    kept = received(f"ltc://{pipe}:{SAMPLES_PER_S}", story)
    assert kept.readings[-1].time_s == pytest.approx(3602.0, abs=0.1)
    assert not kept.failures


def test_a_midi_port_is_read_and_a_file_is_refused(tmp_path: Path) -> None:
    port, file = tmp_path / "midi", tmp_path / "file"
    os.mkfifo(port)
    file.write_bytes(b"\xf1\x00")

    async def story(kept: Kept) -> None:
        with port.open("wb", buffering=0) as outlet:
            for _, sent in zip(range(40), running(START, RATE), strict=False):
                outlet.write(sent.message)
            await kept.until(lambda: len(kept.readings) == 32)

    received(f"midi://{port}", story)

    async def refused(kept: Kept) -> None:
        await kept.until(lambda: bool(kept.failures))

    assert "a pipe or a device is needed" in received(f"midi://{file}", refused).failures[0]
    missing = received(f"midi://{tmp_path}/none", refused).failures[0]
    assert "No such file" in missing


def test_gcs_timecode_prints_a_file(tmp_path: Path) -> None:
    path = tmp_path / "ltc.wav"
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(SAMPLES_PER_S)
        file.writeframes(pcm(sound(START, RATE, 3.0, SAMPLES_PER_S)))
    done = run("gcs", "timecode", str(path), "--json", timeout_s=120.0)
    assert done.returncode == 0
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [line["label"][:8] for line in lines] == ["01:00:00", "01:00:01", "01:00:02"]
    assert {line["frame_rate"] for line in lines} == {"25"}


@pytest.mark.parametrize(
    ("content", "words", "says"),
    [
        (b"RIFF", (), "file.wav"),
        (b"", (), "it ends too early"),
        (b"RIFF", ("--to", "127.0.0.1:5006"), "a file is no clock"),
    ],
)
def test_gcs_timecode_refuses_what_is_no_sound(
    tmp_path: Path, content: bytes, words: tuple[str, ...], says: str
) -> None:
    path = tmp_path / "file.wav"
    path.write_bytes(content)
    done = run("gcs", "timecode", str(path), *words, timeout_s=120.0)
    assert done.returncode != 0
    assert says in done.stderr
    assert "Traceback" not in done.stderr


def test_gcs_timecode_sends_sound_on_as_midi() -> None:
    """Sound goes in as it is played; the service's line is where the sound is, within a tenth of a second."""
    port = free_ports()
    data = pcm(sound(START, RATE, 6.0, SAMPLES_PER_S))
    words = ["timecode", "--samples-per-s", str(SAMPLES_PER_S), "--to", f"127.0.0.1:{port}"]

    async def story(kept: Kept) -> None:
        await asyncio.to_thread(played, words, data)
        assert kept.readings

    kept = received(f"udp-midi://127.0.0.1:{port}", story)
    assert len(kept.readings) > 200
    assert kept.garbage <= 4
    assert kept.readings[-1].time_s == pytest.approx(3606.0, abs=0.3)
    assert kept.chase.slope() == pytest.approx(1.0, abs=0.05)


def unread(pipe: IO[bytes]) -> int:
    """Bytes in a pipe."""
    (count,) = struct.unpack("i", fcntl.ioctl(pipe, termios.FIONREAD, bytes(4)))
    return int(count)


def played(words: Sequence[str], data: bytes) -> None:
    """Run a command of `gcs` that reads samples, and write them as fast as they are played."""
    command = [sys.executable, "-m", "gcs", *words]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0) as process:
        assert process.stdin is not None
        process.stdin.write(bytes(160))  # silence until it reads: sound before that would be late
        while unread(process.stdin):
            time.sleep(0.01)
        size, begin_s = 160, time.monotonic()
        for number, at in enumerate(range(0, len(data), size)):
            time.sleep(max(0.0, begin_s + number * size / 2 / SAMPLES_PER_S - time.monotonic()))
            process.stdin.write(data[at : at + size])
        process.stdin.close()
    assert process.returncode == 0
