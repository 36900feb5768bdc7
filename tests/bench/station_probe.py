"""`gcs serve` with what passes through it noted, for `tests.bench.stations`.

    python -m tests.bench.station_probe FILE serve --config ...

SIGUSR1 begins a measurement, SIGUSR2 ends it and writes it to FILE: how long each position waited for the
setpoint that was made with it, and when batches of states were made here and used here. All processes of one
machine share the monotonic clock.
"""

import json
import signal
import struct
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gcs.bus.interface import Received
from gcs.bus.zenoh_bus import ZenohBus
from gcs.cli.main import main
from gcs.cli.service import serve
from gcs.config.schema import Config
from gcs.config.sections import LinkSettings
from gcs.links.batch_link import Link
from gcs.stations.publishing import STATES
from tests.bench.link_service import Passage

SEQUENCE = struct.Struct("<4xI")
"""Where a batch has its number."""


class Probe:
    """What is noted between the two signals, and nothing before: that takes as much as a tenth of a tick."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._links: list[Link] = []
        self._passages: list[Passage] = []
        self._made: list[tuple[int, float]] = []  # number of the batch, when
        self._used: list[tuple[str, int, float]] = []  # station, number of its batch, when
        self._make_link = serve.make_link
        self._publish, self._newest = ZenohBus.publish, ZenohBus.newest

    def attach(self) -> None:
        """Know the links of this process, and wait for the signals."""
        serve.make_link = self._link
        signal.signal(signal.SIGUSR1, lambda *_: self._begin())
        signal.signal(signal.SIGUSR2, lambda *_: self._write())

    def _link(self, settings: LinkSettings, config: Config, record: Path | None = None) -> Link:
        link = self._make_link(settings, config, record)
        self._links.append(link)
        return link

    def _begin(self) -> None:
        """Let all links and the bus pass it from now on."""
        self._passages = [Passage(link) for link in self._links]
        probe = self

        def publish(bus: ZenohBus, messages: Mapping[str, bytes]) -> None:
            if (payload := messages.get(STATES)) is not None:
                probe._made.append((SEQUENCE.unpack_from(payload)[0], time.monotonic()))
            probe._publish(bus, messages)

        def newest(bus: ZenohBus) -> list[Received]:
            """As the bus does it. The tick that collects a batch is the one that uses it."""
            found = probe._newest(bus)
            now_s = time.monotonic()
            for one in found:
                if one.topic == STATES:
                    probe._used.append((one.sender, SEQUENCE.unpack_from(one.payload)[0], now_s))
            return found

        ZenohBus.publish = publish  # type: ignore[assignment, method-assign]
        ZenohBus.newest = newest  # type: ignore[assignment, method-assign]

    def _write(self) -> None:
        waits_s = [each for passage in self._passages for each in passage.waits_s]
        found = {
            "waits_s": np.concatenate([*waits_s, np.zeros(0)]).round(6).tolist(),
            "made": self._made,
            "used": self._used,
        }
        whole = self._file.with_suffix(".part")
        whole.write_text(json.dumps(found), encoding="utf-8")
        whole.replace(self._file)


if __name__ == "__main__":
    Probe(Path(sys.argv[1])).attach()
    del sys.argv[1]
    sys.exit(main())
