"""Events, marks, alarms and take-off positions of a session, from its audit and its recorded status."""

import json
from bisect import bisect_right
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from gcs.model.errors import GcsError
from gcs.model.state import Array, VehicleId
from gcs.recording.audit_reader import AUDIT, PAD, rows
from gcs.service import FlightMarks
from gcs.service.alarms import CAUSES, Alarm, AlarmCause
from gcs.service.event_log import KEPT, LogEvent, severity, words
from gcs.service.flight_marks import RecordedEvent, marks_of

PLAN: Final = "plan"

EVENTS: Final = (
    "SELECT unix_s, level, event, vehicle, detail FROM events WHERE session = ? ORDER BY unix_s, rowid"
)


class EventHistory:
    """One session's events, in order."""

    def __init__(self, events: Sequence[RecordedEvent]) -> None:
        """Raises: KeyError, TypeError or ValueError for invalid events."""
        self._events = tuple(events)
        self._happened: list[LogEvent] = []
        self._pads: dict[VehicleId, list[tuple[float, Array]]] = {}
        for unix_s, level, event, vehicle, detail in events:
            if event == PAD and vehicle is not None:
                pad_m = np.array(detail["pad_m"], dtype=np.float64)
                self._pads.setdefault(vehicle, []).append((unix_s, pad_m))
                continue
            text = "the plan was changed" if event == PLAN else words(event, detail)
            number = len(self._happened) + 1
            self._happened.append(LogEvent(number, unix_s, severity(level), text, vehicle))
        self._times_s = [each.unix_time_s for each in self._happened]

    @staticmethod
    def of(flight: Path, session: str) -> "EventHistory":
        """Read a session from the audit in the folder above that of its flight data; empty without one.

        Raises: GcsError when there is one, and it cannot be read.
        """
        file = flight.absolute().parent.parent / AUDIT
        if not file.is_file():
            return EventHistory(())
        try:
            event_rows = rows(file, EVENTS, session)
            return EventHistory(
                [RecordedEvent(**{**dict(row), "detail": json.loads(row["detail"])}) for row in event_rows]
            )
        except (KeyError, TypeError, ValueError) as error:
            raise GcsError(f"{file}: its events are none: {error!r}") from None

    def until(self, unix_s: float) -> tuple[LogEvent, ...]:
        """The newest events up to that time, newest last."""
        end = bisect_right(self._times_s, unix_s)
        return tuple(self._happened[max(end - KEPT, 0) : end])

    def marks(self, began_unix_s: float, duration_s: float) -> FlightMarks:
        """Marks of the whole session. Raises: GcsError for invalid events."""
        try:
            return marks_of(self._events, began_unix_s, duration_s)
        except (KeyError, ValueError) as error:
            raise GcsError(f"the audit's events cannot be read: {error!r}") from None

    def home_m(self, vehicle: VehicleId, unix_s: float) -> Array | None:
        """(3,) Its last take-off position, show frame; None: it had not taken off, or it is not recorded."""
        pads = self._pads.get(vehicle, [])
        at = bisect_right(pads, unix_s, key=lambda pad: pad[0]) - 1
        return pads[at][1] if at >= 0 else None


def replay_alarm(path: Path, began_unix_s: float, *, ended: bool, cut: str) -> Alarm:
    """Return the alarm that what is shown is a replay; `cut` says what is missing at the record's end."""
    over = f" The record has ended. {cut}".rstrip() if ended else ""
    cause, row = AlarmCause.REPLAY, CAUSES[AlarmCause.REPLAY]
    text = f"{row.headline}: this is a record of {path}. Nothing here flies.{over}"
    return Alarm(cause.value, row.severity, cause, text, row.advice, (), began_unix_s, began_unix_s)
