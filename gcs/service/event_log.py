"""Recent events in words: the newest lines of the service's own log."""

import logging
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from itertools import count
from typing import Final

from gcs.model.state import VehicleId
from gcs.service.event_texts import words

KEPT: Final = 100

_PLAIN: Final = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime", "taskName", "vehicle"}


class Severity(StrEnum):
    """Severity of an event."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class LogEvent:
    """One event."""

    number: int  # counts up
    unix_time_s: float
    severity: Severity
    text: str
    vehicle: VehicleId | None  # None: it concerns no single vehicle


def vehicle_of(record: logging.LogRecord) -> VehicleId | None:
    """Return the vehicle that a log record is about."""
    vehicle = getattr(record, "vehicle", None)
    return None if vehicle is None else str(vehicle)


def details(record: logging.LogRecord) -> dict[str, object]:
    """Return the log record's further fields."""
    return {key: value for key, value in vars(record).items() if key not in _PLAIN}


def severity(level: str) -> Severity:
    """Return the severity of a log level, by its name."""
    return {"info": Severity.INFO, "warning": Severity.WARNING}.get(level, Severity.ERROR)


class EventLog(logging.Handler):
    """Keeps the newest log records. Written on any thread, read on the loop."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._kept: deque[LogEvent] = deque(maxlen=KEPT)
        self._numbers = count(1)

    def emit(self, record: logging.LogRecord) -> None:
        """Keep one record."""
        text = words(record.getMessage(), details(record))
        how = severity(record.levelname.lower())
        self._kept.append(LogEvent(next(self._numbers), record.created, how, text, vehicle_of(record)))

    def newest(self) -> tuple[LogEvent, ...]:
        """Newest events, newest last."""
        return tuple(self._kept)


@contextmanager
def attached(handler: logging.Handler) -> Iterator[None]:
    """Attach a handler to the service's loggers at level INFO, until the block ends.

    The API's logger is left out: denied calls would displace the flight's own events.
    """
    logger = logging.getLogger("gcs")
    level = logger.level
    handler.addFilter(_is_of_the_flight)
    logger.addHandler(handler)
    if logger.getEffectiveLevel() > logging.INFO:
        logger.setLevel(logging.INFO)  # the other handlers decide what is shown
    try:
        yield
    finally:
        logger.removeHandler(handler)
        handler.removeFilter(_is_of_the_flight)
        logger.setLevel(level)


def _is_of_the_flight(record: logging.LogRecord) -> bool:
    return not record.name.startswith(("gcs.api", "gcs.sim"))
