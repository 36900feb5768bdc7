"""The alarms of a recorded moment, as they were then."""

from pathlib import Path

from gcs.recording.mcap_layout import STATUS, status_message
from gcs.recording.replay.history import replay_alarm
from gcs.service.alarms import AlarmSeverity
from tests.support.record_samples import FULL, sample

FILE = Path("flight.mcap")


def test_alarms_of_an_instant_are_read_back() -> None:
    assert STATUS.validate_json(status_message(sample())).alarms == (FULL,)


def test_replay_reports_no_flight_and_the_end_of_the_record() -> None:
    alarm = replay_alarm(FILE, 1.7e9, ended=True, cut="It was cut off.")
    assert alarm.severity is AlarmSeverity.INFORMATION
    assert alarm.text == (
        "Replay: this is a record of flight.mcap. Nothing here flies. The record has ended. It was cut off."
    )
