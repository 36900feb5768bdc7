"""The alarms of a recorded moment, as they were then."""

import json
from pathlib import Path

import pytest

from gcs.model.errors import GcsError
from gcs.recording.mcap_layout import status_message
from gcs.recording.replay.history import recorded, replay_alarm
from gcs.service.alarms import AlarmCause, AlarmSeverity
from tests.support.record_samples import FULL, sample

FILE = Path("flight.mcap")


def test_alarms_of_an_instant_are_read_back() -> None:
    status = json.loads(status_message(sample()))
    assert recorded(status, FILE, 1.7e9) == (FULL,)


def test_record_without_alarms_shows_its_problems() -> None:
    (note,) = recorded({"problems": ["record: the disk is full"]}, FILE, 1.7e9)
    assert note.text == "Note: record: the disk is full."
    assert (note.cause, note.severity) == (AlarmCause.SERVICE_NOTE, AlarmSeverity.INFORMATION)


@pytest.mark.parametrize("alarms", [[{}], [7], None, [{"severity": "loud"}]])
def test_invalid_alarms_are_reported_with_the_file(alarms: object) -> None:
    with pytest.raises(GcsError, match=r"flight\.mcap: its alarms are none"):
        recorded({"alarms": alarms}, FILE, 1.7e9)


def test_replay_reports_no_flight_and_the_end_of_the_record() -> None:
    alarm = replay_alarm(FILE, 1.7e9, ended=True, cut="It was cut off.")
    assert alarm.severity is AlarmSeverity.INFORMATION
    assert alarm.text == (
        "Replay: this is a record of flight.mcap. Nothing here flies. The record has ended. It was cut off."
    )
