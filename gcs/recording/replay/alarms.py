"""The alarms at one time of a record."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gcs.model.errors import GcsError
from gcs.service.alarms import CAUSES, Alarm, AlarmCause, AlarmSeverity


def replay_alarm(path: Path, began_unix_s: float, *, ended: bool, cut: str) -> Alarm:
    """Return the alarm that what is shown is a replay; `cut` says what is missing at the record's end."""
    over = f" The record has ended. {cut}".rstrip() if ended else ""
    row = CAUSES[AlarmCause.REPLAY]
    text = f"{row.headline}: this is a record of {path}. Nothing here flies.{over}"
    return _reported(AlarmCause.REPLAY, AlarmCause.REPLAY.value, text, began_unix_s)


def recorded(status: Mapping[str, Any], path: Path, began_unix_s: float) -> tuple[Alarm, ...]:
    """Return the alarms of a recorded `/fleet/status`; older files have `problems`, in words.

    Raises: GcsError for invalid data.
    """
    try:
        if "alarms" in status:
            return tuple(_alarm(raw) for raw in status["alarms"])
        problems: Sequence[str] = status["problems"]
        note = AlarmCause.SERVICE_NOTE
        return tuple(
            _reported(note, f"{note}-{number}", f"{CAUSES[note].headline}: {text}.", began_unix_s)
            for number, text in enumerate(problems, start=1)
        )
    except (KeyError, TypeError, ValueError) as error:
        raise GcsError(f"{path}: its alarms are none: {error!r}") from None


def _alarm(raw: Mapping[str, Any]) -> Alarm:
    """Parse one alarm. Raises: KeyError, TypeError or ValueError."""
    return Alarm(
        **{
            **raw,
            "severity": AlarmSeverity(raw["severity"]),
            "cause": AlarmCause(raw["cause"]),
            "vehicles": tuple(raw["vehicles"]),
        }
    )


def _reported(cause: AlarmCause, alarm_id: str, text: str, unix_s: float) -> Alarm:
    row = CAUSES[cause]
    return Alarm(alarm_id, row.severity, cause, text, row.advice, (), unix_s, unix_s)
