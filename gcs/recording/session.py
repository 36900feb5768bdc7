"""The record of one session: its folder, its audit, its flight data, and what the log says meanwhile."""

import logging
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Final, Self

from gcs.links import Link
from gcs.model.interrupted_flight import Interruption
from gcs.model.preflight_report import Exclusion
from gcs.model.state import VehicleId
from gcs.recording import mcap_layout as layout
from gcs.recording.audit import Audit
from gcs.recording.last_known import AUDIT
from gcs.recording.mcap_writer import WAITING_MAX, FlightFile, LogLine
from gcs.recording.sample import Sample
from gcs.recording.sqlite_writer import Journal
from gcs.service.event_log import details, received, vehicle_of
from gcs.service.event_texts import plain

WHEREABOUTS_S: Final = 1.0


class Record:
    """Everything of one session. Used on the event loop; what touches the disk has threads of its own."""

    def __init__(
        self,
        root: Path,
        config_json: str,
        vehicles: Mapping[VehicleId, tuple[int, str]],
        *,
        flight: bool = True,
        found: Interruption | None = None,
        excluded: Mapping[VehicleId, Exclusion] = MappingProxyType({}),
    ) -> None:
        """Nothing is written before it is entered.

        Args:
            root: holds the audit of all sessions, and a folder for the flight data of each.
            config_json: the whole configuration.
            vehicles: system id and link of each, in the order of the ticks' rows.
            flight: whether flight data are recorded.
            found: the flight that was cut off before, if one was.
            excluded: who was out of the show before.
        """
        self.session, self.folder = _new_folder(root)
        self._config_json = config_json
        self.found = found
        self.excluded = excluded
        self._journal = Journal(root / AUDIT)
        self.audit = Audit(self._journal, self.session, vehicles)
        about = layout.about(self.session, config_json, vehicles)
        self._flight = FlightFile(self.folder, about) if flight else None
        self._received = _LogHandler(self.audit, self._flight)
        self._listening = ExitStack()
        self._whereabouts_due_s = 0.0

    def __enter__(self) -> Self:
        """Begin to write, as soon as the disk allows."""
        self._journal.open()
        self.audit.begin(self.folder, self._config_json, self.found)
        if self._flight is not None:
            self._flight.open()
        self._listening.enter_context(received(self._received))
        return self

    def __exit__(self, *_error: object) -> None:
        """Write what is left, and note that the session has ended. Blocks for some milliseconds."""
        self._listening.close()
        if self._flight is not None:
            self._flight.close()
        self.audit.end()
        self._journal.close()

    @property
    def problems(self) -> tuple[str, ...]:
        """What is not being recorded, in words; empty while all is."""
        flight = "" if self._flight is None else self._flight.problem
        return tuple(f"record: {problem}" for problem in (self._journal.problem, flight) if problem)

    @property
    def has_room(self) -> bool:
        """Less than half of the flight data that may wait do: who is faster than time waits for it."""
        return self._flight is None or self._flight.waiting < WAITING_MAX // 2

    def note(self, sample: Sample, links: Sequence[Link]) -> None:
        """Take in one tick, and where the vehicles of the links speak from."""
        self.audit.watch(sample)
        if self._flight is not None:
            self._flight.put(sample)
        if sample.fleet.time_s >= self._whereabouts_due_s:
            self._whereabouts_due_s = sample.fleet.time_s + WHEREABOUTS_S
            for link in links:
                self.audit.whereabouts(link.addresses)


class _LogHandler(logging.Handler):
    """What the service's own loggers say, as events: the log and the record tell the same."""

    def __init__(self, audit: Audit, flight: FlightFile | None) -> None:
        super().__init__(logging.INFO)
        self._audit = audit
        self._flight = flight

    def emit(self, record: logging.LogRecord) -> None:
        """Note one line of the log. On any thread."""
        stated, name = details(record), vehicle_of(record)
        level, event = record.levelname.lower(), record.getMessage()
        self._audit.event(record.created, level, event, name, stated)
        if self._flight is not None:
            reported = " ".join(f"{key}={plain(value)}" for key, value in stated.items())
            self._flight.put(LogLine(record.created, level, event, f"{name or ''} {reported}".strip()))


def _new_folder(root: Path) -> tuple[str, Path]:
    """A name that no session has, and its folder, which is made where the disk lets us."""
    began = datetime.now(UTC).strftime("%Y%m%d-%H%M%S-%f")[:-3]
    for turn in range(1, 1000):
        name = began if turn == 1 else f"{began}-{turn}"
        try:
            (root / name).mkdir(parents=True)
        except FileExistsError:
            if (root / name).is_dir():
                continue
        except OSError:
            pass  # full or read-only: whoever writes there says so, and tries again
        return name, root / name
    return began, root / began
