"""Recent events in words: the newest lines of the service's own log, and the text of each event."""

import logging
import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum, StrEnum
from itertools import count
from typing import Annotated, Final

from pydantic import Field

from gcs.model.errors import visible
from gcs.model.state import VehicleId

KEPT: Final = 100

_PLAIN: Final = frozenset(vars(logging.makeLogRecord({}))) | {"message", "asctime", "taskName", "vehicle"}

WORDS: Final[Mapping[str, str]] = {
    "access_denied": "access denied to {caller} from {address}: {method} {path} [({count} times)]: {reason}",
    "access_off": "access is off on {host}: {means}",
    "access_without_tls": "access without TLS on {host}: set {fix}",
    "alarm": "{severity}: {text}",
    "alarm_acknowledged": "acknowledged by {by}: {text}",
    "alarm_over": "over: {text}",
    "api_failed": "API on {listener} failed, and is started again: {cause}",
    "battery_forgotten": "battery pack {pack}, the emptiest, fell silent on the ground: it is left out",
    "cannot_connect": "link {link} cannot connect to {address}: {cause}",
    "checklist_reopened": "checklist {role}: {items} opened again by {by}",
    "checklist_signed": "checklist {role}: {items} signed by {by}",
    "checklists_open": "{count} signed items of the checklists are open again: {reason}",
    "columns_overlap": "stacked pairs: {reason}",
    "connected": "link {link} connected to {address}",
    "connection_lost": "link {link} lost the connection to {address}: {cause}",
    "cue": "cue {cue} of show {name}",
    "duplicate_system_id": "system id {system_id} is used twice on link {link}: {cause}",
    "excluded": "taken out of the show by {by}: {reason}",
    "interrupted": "{cause} while the show was {show}: take-over and bring-home settle it",
    "service_stalled": "the service stalled for {stalled_s} s while the show was {show}",
    "folder_not_locked": "{folder} cannot be locked, so no second service on it is noticed: {cause}",
    "found_interrupted": "session {of_session} was cut off while the show was {was}[: {mismatches}]",
    "ground_met": "stands {height_m} m above its place by its own height: its autopilot touches it down",
    "included": "taken into the show again by {by}",
    "interruption_over": "the flight of session {of_session} that was cut off is settled",
    "key_file_open": "the key file {file} can be read by others: {fix}",
    "kill": "motors stopped on command",
    "kill_without_control": "kill of {vehicles} by {by}, sent without control, which does not answer",
    "land_refused": "LAND was refused, and is sent again: {reason}",
    "lands_in_place": "its autopilot lands it {place}: {reason}.[{waited}][{hits}]",
    "landing_place_closed": "an obstacle has come to its landing place: it lands elsewhere",
    "link_failed": "link {link} failed, and is opened again: {cause}",
    "map_missing": "no map: {cause}",
    "mavsdk": "MAVSDK: {reported}",
    "no_progress": "no progress in phase {phase}",
    "offboard_refused": "OFFBOARD was refused, its autopilot lands it: {reason}",
    "command": "command {action} by {by}[: {count} vehicles]",
    "command_failed": "command failed: {reason}",
    "pads_exchanged": "the pads are assigned anew: {count} vehicles land on another one than they left",
    "parameters_read": "parameters read",
    "position_reset": "{reason}",
    "failsafe": "{action}[ of {vehicles}] by the service: {cause} ({reason})",
    "failsafe_over": "over: {cause}",
    "record_unread": "the record of the last session cannot be read: {cause}",
    "recording": "telemetry is recorded in {file}",
    "recording_failed": "{what} are not recorded: {cause}",
    "recording_resumed": "{what} are recorded again in {place}",
    "refused_by_lead": "station {other} refused {change} of {by}: {reason}",
    "return_planner_failed": "the vehicles return without a common plan: {reason}",
    "send_failed": "link {link} could not send[ to {address}]: {cause}",
    "show_check_failed": "the check of show {show} failed: {reason}",
    "show_began": "show {show} began[, {late_s} s after its time]",
    "show_begin_cancelled": "show {show}: its time to begin is cancelled",
    "site_changed": "the site is changed in {file} by {by}; in force from the next start of the service on",
    "start_hashes": "{command} takes off[; site {site_hash}][; show {show_hash}]"
    "[; parameters {parameters_hash}]",
    "target_not_restored": "target {target} is not followed any more, the formation holds: {reason}",
    "show_begin_forgotten": "show {show} does not begin at {at} any more: {reason}",
    "show_begins_at": "show {show} begins at {at}[ ({reason})]",
    "show_not_here": "the selected show cannot be flown by this station: {reason}",
    "show_phase": "show {phase}[: {reason}]",
    "show_selected": "show {show} selected",
    "signature_refused": "signature refused of system id {system_id} at {address} on link {link}: {cause}",
    "signing_time_not_kept": "the time of MAVLink signing is not kept: {cause}",
    "spare_flies": "takes the place of {other}, which is lost",
    "stranger_ignored": "system id {system_id} at {address} on link {link} is not configured: ignored",
    "start_confirmed": "start of {proposed_by} confirmed by {by}, hash {hash}",
    "start_not_confirmed": "the start of {by} was not confirmed: {reason}",
    "start_proposed": "start of {count} vehicles proposed by {by}, to be confirmed in {within_s} s: {hash}",
    "supervisor_gone": "nothing restarts this service any more: {cause}",
    "takeoff_failed": "take-off failed: {reason}",
    "token_file_open": "the token file {file} can be read by others: {fix}",
    "tokens_not_read_again": "the token file cannot be read, the old tokens stay valid: {cause}",
    "tokens_read_again": "tokens read again: {names}",
    "vehicle_connected": "system id {system_id} received at {address} on link {link}",
    "vehicle_mode": "mode {mode}",
    "vehicle_moved": "system id {system_id} on link {link} is now at {address}",
    "vehicle_not_discovered": "MAVSDK does not find system id {system_id}: {cause}",
    "vehicle_phase": "{phase}[: {reason}]",
    "weather_entered": "weather entered by {by}: {weather}",
    "vehicles_discovered": "MAVSDK found system ids {system_ids} on link {link}",
}
"""Text of each event; a part in brackets is omitted when its values are unknown. The vehicle concerned is
shown beside it.
"""

_FIELD: Final = re.compile(r"\{(\w+)\}")
_OPTIONAL: Final = re.compile(r"\[([^\]]*)\]")

_WHY: Final = ("reason", "cause")


class Severity(StrEnum):
    """Severity of an event."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class LogEvent:
    """One event of the service's log."""

    number: Annotated[int, Field(description="Increases since the service began.")]
    unix_time_s: float
    severity: Severity
    text: str
    vehicle: Annotated[
        VehicleId | None, Field(description="The vehicle concerned; null: none in particular.")
    ]


def vehicle_of(record: logging.LogRecord) -> VehicleId | None:
    vehicle = getattr(record, "vehicle", None)
    return None if vehicle is None else str(vehicle)


def details(record: logging.LogRecord) -> dict[str, object]:
    return {key: value for key, value in vars(record).items() if key not in _PLAIN}


def severity(level: str) -> Severity:
    return {"info": Severity.INFO, "warning": Severity.WARNING}.get(level, Severity.ERROR)


class EventLog(logging.Handler):
    """Keeps the newest log records. Written on any thread, read on the loop."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._kept: deque[LogEvent] = deque(maxlen=KEPT)
        self._numbers = count(1)

    def emit(self, record: logging.LogRecord) -> None:
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


def words(event: str, reported: Mapping[str, object]) -> str:
    """Return the text of an event with the fields of its log record."""
    texts = {name: text for name, value in reported.items() if (text := plain(value))}
    form = WORDS.get(event)
    if form is not None:
        form = _OPTIONAL.sub(lambda part: part[1] if _fields(part[1]) <= texts.keys() else "", form)
        if _fields(form) <= texts.keys():
            return _FIELD.sub(lambda field: texts[field[1]], form)
    rest = [f"{name.replace('_', ' ')} {text}" for name, text in texts.items() if name not in _WHY]
    why = [texts[name] for name in _WHY if name in texts]
    return ": ".join(filter(None, (event.replace("_", " "), ", ".join(rest), "; ".join(why))))


def plain(value: object) -> str:
    """Format a value for display; empty for none."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, Mapping):
        return ", ".join(f"{plain(name)} {plain(part)}" for name, part in value.items())
    if isinstance(value, Iterable) and not isinstance(value, str | bytes):
        return ", ".join(plain(part) for part in value)
    return visible(str(value)).replace("\n", " ")


def _fields(form: str) -> set[str]:
    return set(_FIELD.findall(form))
