"""`gcs replay` in a separate process, and a replay of a minute in which nothing happens."""

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Unpack

from gcs.recording.replay.service import Playhead
from gcs.service import CheckState, Playback, PlaybackChange, ReportState
from tests.support.started import PIPE, Started


@contextmanager
def replay(record: Path | str, *options: str, folder: Path | None = None) -> Iterator[str]:
    """Run a replay in `folder` until the block ends, then end it by request. Yields the API's address."""
    process = Started("gcs", "replay", str(record), "--port", "0", *options, stdout=PIPE, folder=folder)
    try:
        assert process.stdout is not None
        address = re.search(r"http://\S+:\d+", process.stdout.readline())
        assert address is not None
        yield address[0]
    finally:
        process.terminate()
        code = process.wait(120.0)
        process.end()
    assert code == 0


class FakeRecord:
    """A `gcs.service.Replaying` with a real playhead."""

    def __init__(self) -> None:
        self._head = Playhead(60.0, 1.0, time.monotonic())
        self.report_state = ReportState(CheckState.RUNNING)

    @property
    def playback(self) -> Playback:
        head, at_s = self._head, self._head.position_s(time.monotonic())
        return Playback(
            "flight.mcap", 1.7e9, 60.0, at_s, head.speed, head.paused, ended=False, skips_idle=head.skips_idle
        )

    def change(self, **given: Unpack[PlaybackChange]) -> Playback:
        self._head.change(time.monotonic(), **given)
        return self.playback

    def make_flight_report(self) -> ReportState:
        return self.report_state
