"""What the wire itself read from one vehicle: arrival times, and the heartbeat's word on mode and arming."""

import asyncio
from collections import Counter
from math import inf

from gcs.links.mavlink_frames import (
    GLOBAL_POSITION_INT,
    HEARTBEAT,
    STATUSTEXT,
    SYS_STATUS,
    Frame,
    TextChunk,
    boot_time_ms,
    heartbeat,
    prearm_ok,
    status_text,
)
from gcs.state import Mode

_AUTOPILOT_COMPONENT = 1
_TEXT_CHUNKS_MAX = 8
_REBOOT_MS = 1000  # farther back than datagrams overtake each other


class Heard:
    """Newest known of one vehicle, and when it arrived. Written and read on the loop's thread.

    Attributes:
        time_s: arrival of any frame; `heartbeat_time_s` and `position_time_s` of their own, -inf before.
        armed, mode: from the autopilot's heartbeat, which alone is believed.
        prearm_ok: SYS_STATUS says that the autopilot's own checks before arming pass.
        text, text_time_s: the newest status text, and its arrival.
        boots: how often its boot clock has jumped back: restarts, and pauses of a simulator.
        counts: how many messages of each kind the autopilot has sent.
        news: fires at the next heartbeat, and is then replaced.
    """

    def __init__(self) -> None:
        self.time_s = -inf
        self.heartbeat_time_s = -inf
        self.position_time_s = -inf
        self.armed = False
        self.mode = Mode.UNKNOWN
        self.prearm_ok = False
        self.text = ""
        self.text_time_s = -inf
        self.boots = 0
        self.counts: Counter[int] = Counter()
        self.news = asyncio.Event()
        self._boot_time_ms = 0
        self._chunks: list[TextChunk] = []

    def take(self, frame: Frame, time_s: float) -> None:
        """Read one checked frame of this vehicle. Frames of its other components count as arrivals only."""
        self.time_s = time_s
        if frame.component_id != _AUTOPILOT_COMPONENT:
            return
        message_id = frame.message_id
        self.counts[message_id] += 1
        if message_id == GLOBAL_POSITION_INT:
            self.position_time_s = time_s
            self._take_boot_time(boot_time_ms(frame))
        elif message_id == HEARTBEAT:
            self._take_heartbeat(frame, time_s)
        elif message_id == SYS_STATUS:
            self.prearm_ok = prearm_ok(frame)
        elif message_id == STATUSTEXT:
            self._take_text(status_text(frame), time_s)

    def _take_boot_time(self, time_ms: int) -> None:
        if time_ms + _REBOOT_MS < self._boot_time_ms:
            self.boots += 1
        elif time_ms < self._boot_time_ms:
            return  # one that was overtaken
        self._boot_time_ms = time_ms

    def _take_heartbeat(self, frame: Frame, time_s: float) -> None:
        said = heartbeat(frame)
        if not said.autopilot:
            return
        self.heartbeat_time_s = time_s
        self.armed, self.mode = said.armed, said.mode
        fired, self.news = self.news, asyncio.Event()
        fired.set()

    def _take_text(self, chunk: TextChunk, time_s: float) -> None:
        """Put long texts together; one with a chunk missing is shown with what there is."""
        follows = self._chunks and chunk.text_id == self._chunks[0].text_id and chunk.text_id != 0
        self._chunks = [*self._chunks, chunk][-_TEXT_CHUNKS_MAX:] if follows else [chunk]
        self.text = b"".join(part.text for part in self._chunks).decode(errors="replace").strip()
        self.text_time_s = time_s
        if chunk.last:
            self._chunks = []
