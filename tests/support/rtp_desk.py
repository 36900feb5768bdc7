"""A desk that sends MIDI timecode over RTP in real time, from a thread: a session with a service."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from typing import Self

from gcs.shows.timecode import Rate
from gcs.shows.timecode.smpte import Label
from tests.support.timecode import INVITATION, full_frame, rtp, running

RATE = Rate.FPS_25
ANSWER_S = 30.0


class RtpDesk:
    """One session. Use it as a context manager; it invites `port` and the port after it."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._numbers = count(1)

    def __enter__(self) -> Self:
        self._socket.settimeout(ANSWER_S)
        for port in (self._port, self._port + 1):
            self._socket.sendto(INVITATION, ("127.0.0.1", port))
            answer = self._socket.recv(100)
            assert answer.startswith(b"\xff\xffOK"), answer
        return self

    def __exit__(self, *_error: object) -> None:
        self._socket.close()

    def _send(self, message: bytes) -> None:
        self._socket.sendto(rtp([message], next(self._numbers) % 2**16), ("127.0.0.1", self._port + 1))

    def stands_at(self, place: Label) -> None:
        """Say by a full frame where it stands."""
        self._send(full_frame(place, RATE))

    @contextmanager
    def runs(self, start: Label) -> Iterator[None]:
        """Run from `start`, with an even number of frames, on; after the block it is silent."""
        over = threading.Event()
        thread = threading.Thread(target=self._run, args=(start, over), name="desk")
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def _run(self, start: Label, over: threading.Event) -> None:
        began_s = time.monotonic()
        for sent in running(start, RATE):
            if over.wait(max(0.0, began_s + sent.at_s - time.monotonic())):
                return
            self._send(sent.message)
