"""The record of one session: its folder, its audit, its flight data, and its log events."""

import logging
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Final, Self

from gcs.links.batch_link import Link
from gcs.model.interrupted_flight import Interruption
from gcs.model.preflight_report import Exclusion
from gcs.model.state import VehicleId
from gcs.recording import mcap_layout as layout
from gcs.recording.audit import AuditTrail
from gcs.recording.audit_database import Journal
from gcs.recording.audit_reader import AUDIT, LostBegin
from gcs.recording.mcap_writer import WAITING_MAX, FlightFile, LogLine
from gcs.recording.sample import Sample
from gcs.service.event_log import attached, details, plain, vehicle_of

WHEREABOUTS_S: Final = 1.0


class Record:
    """The whole record of one session. Used on the event loop; disk access has threads of its own."""

    def __init__(
        self,
        root: Path,
        config_json: str,
        vehicles: Mapping[VehicleId, tuple[int, str]],
        *,
        flight: bool = True,
        interruption: Interruption | None = None,
        excluded: Mapping[VehicleId, Exclusion] = MappingProxyType({}),
        lost_begin: LostBegin | None = None,
        elsewhere: Mapping[VehicleId, tuple[int, str]] = MappingProxyType({}),
        site_json: str | None = None,
        autopilots: Mapping[VehicleId, str] = MappingProxyType({}),
        site_hash: str = "",
    ) -> None:
        """Writes nothing before it is entered.

        Args:
            root: contains the audit of all sessions, and a folder for the flight data of each.
            config_json: the whole configuration.
            vehicles: system id and link of each, in the order of the ticks' rows.
            flight: whether flight data are recorded.
            interruption: the flight that was interrupted before, if any.
            excluded: vehicles excluded from the show before.
            lost_begin: the show that still waited for its clock time before, if any.
            elsewhere: the same of other stations' vehicles, which follow in the flight data.
            site_json: the configuration of all stations, for the flight data; None: there is one station.
            autopilots: name of each vehicle's, for the flight data; empty: the usual one.
            site_hash: of the areas that are flown in, for the flight data; empty: there are none.
        """
        self.session, self.folder = _new_folder(root)
        self._config_json = config_json
        self.found = interruption
        self.excluded, self.lost_begin = excluded, lost_begin
        self._journal = Journal(root / AUDIT)
        self.audit = AuditTrail(self._journal, self.session, vehicles)
        everything = {**vehicles, **elsewhere}
        about = layout.about(
            self.session,
            site_json or config_json,
            everything,
            autopilots,
            len(everything) - len(vehicles),
            site_hash,
        )
        self._flight = FlightFile(self.folder, about) if flight else None
        self._handler = _LogHandler(self.audit, self._flight)
        self._attached = ExitStack()
        self._whereabouts_due_s = 0.0

    def __enter__(self) -> Self:
        self._journal.open()
        self.audit.begin(self.folder, self._config_json, self.found)
        if self._flight is not None:
            self._flight.open()
        self._attached.enter_context(attached(self._handler))
        return self

    def __exit__(self, *_error: object) -> None:
        """Write what is left, and record the end of the session. Blocks for some milliseconds."""
        self._attached.close()
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
        """Whether less than half of the flight data queue is used: virtual-time runs wait for it."""
        return self._flight is None or self._flight.waiting < WAITING_MAX // 2

    def note(self, sample: Sample, links: Sequence[Link]) -> None:
        """Record one tick, and the addresses of the links' vehicles."""
        self.audit.watch(sample)
        if self._flight is not None:
            self._flight.add(sample)
        if sample.view.time_s >= self._whereabouts_due_s:
            self._whereabouts_due_s = sample.view.time_s + WHEREABOUTS_S
            for link in links:
                self.audit.whereabouts(link.addresses)


class _LogHandler(logging.Handler):
    """Records the log messages of the service's own loggers as events."""

    def __init__(self, audit: AuditTrail, flight: FlightFile | None) -> None:
        super().__init__(logging.INFO)
        self._audit = audit
        self._flight = flight

    def emit(self, record: logging.LogRecord) -> None:
        fields, name = details(record), vehicle_of(record)
        level, event = record.levelname.lower(), record.getMessage()
        self._audit.event(record.created, level, event, name, fields)
        if self._flight is not None:
            reported = " ".join(f"{key}={plain(value)}" for key, value in fields.items())
            self._flight.add(LogLine(record.created, level, event, f"{name or ''} {reported}".strip()))


def _new_folder(root: Path) -> tuple[str, Path]:
    """Return an unused session name, and its folder, created if the disk allows."""
    began = datetime.now(UTC).strftime("%Y%m%d-%H%M%S-%f")[:-3]
    for turn in range(1, 1000):
        name = began if turn == 1 else f"{began}-{turn}"
        try:
            (root / name).mkdir(parents=True)
        except FileExistsError:
            if (root / name).is_dir():
                continue
        except OSError:
            pass  # full or read-only: the writers report it, and try again
        return name, root / name
    return began, root / began
