"""What happened last, in words: the newest lines of the service's own log."""

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
    """How much it matters."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class LogEvent:
    """Something that happened."""

    number: int  # counts up
    unix_time_s: float
    severity: Severity
    text: str
    vehicle: VehicleId | None  # whom it concerns; None: nobody in particular


def vehicle_of(record: logging.LogRecord) -> VehicleId | None:
    """Whom a line of the log is about."""
    vehicle = getattr(record, "vehicle", None)
    return None if vehicle is None else str(vehicle)


def details(record: logging.LogRecord) -> dict[str, object]:
    """What a line of the log says besides."""
    return {key: value for key, value in vars(record).items() if key not in _PLAIN}


def severity(level: str) -> Severity:
    """Of a level of the log, by its name."""
    return {"info": Severity.INFO, "warning": Severity.WARNING}.get(level, Severity.ERROR)


class EventLog(logging.Handler):
    """The newest lines of the log. Heard on any thread, read on the loop."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._kept: deque[LogEvent] = deque(maxlen=KEPT)
        self._numbers = count(1)

    def emit(self, record: logging.LogRecord) -> None:
        """Keep one."""
        text = words(record.getMessage(), details(record))
        how = severity(record.levelname.lower())
        self._kept.append(LogEvent(next(self._numbers), record.created, how, text, vehicle_of(record)))

    def newest(self) -> tuple[LogEvent, ...]:
        """The newest last."""
        return tuple(self._kept)


@contextmanager
def received(handler: logging.Handler) -> Iterator[None]:
    """Have a handler receive what the service's loggers report, information included, until the block ends.

    Not what the API reports: denied calls would push the flight's own events out.
    """
    logger = logging.getLogger("gcs")
    level = logger.level
    handler.addFilter(_is_of_the_flight)
    logger.addHandler(handler)
    if logger.getEffectiveLevel() > logging.INFO:
        logger.setLevel(logging.INFO)  # what is shown is the other handlers' business
    try:
        yield
    finally:
        logger.removeHandler(handler)
        handler.removeFilter(_is_of_the_flight)
        logger.setLevel(level)


def _is_of_the_flight(record: logging.LogRecord) -> bool:
    return not record.name.startswith(("gcs.api", "gcs.sim"))
