"""A reaction is in the record: a command that no operator gave, what became of it, and why it was given."""

from pathlib import Path

import pytest

from gcs.failsafe.policy import Cause
from gcs.recording.session import Record
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from tests.support.audit_rows import commands, events
from tests.support.failsafe_flights import carried_out, failsafe, reacts


async def low_battery(show: VirtualShow) -> None:
    await show.start()
    show.befall("d2", "battery", remaining=0.17)
    await carried_out(show, await reacts(show, Cause.LOW_BATTERY))
    await show.until(lambda: failsafe(show, Cause.LOW_BATTERY) is None)
    await show.wait(0.1)


@pytest.mark.soak
def test_failsafe_is_audited_as_a_command_with_its_cause(tmp_path: Path) -> None:
    config = show_config(3)
    vehicles = {name: (row + 1, "loop") for row, name in enumerate(config.ids)}
    with Record(tmp_path, config.model_dump_json(), vehicles) as record:
        fly(low_battery, config, record=record)
    (command,) = [each for each in commands(tmp_path) if each.action == "return"]
    assert (command.caller, dict(command.outcomes)) == ("service", {"d2": ("done", "")})
    (reported,) = [event["detail"] for event in events(tmp_path) if event["event"] == "failsafe"]
    assert reported["cause"] == "low battery"
    assert reported["command"] == command.id
    assert reported["vehicles"] == ["d2"]
    assert reported["reason"] == "battery at 17%, below 20%"
    assert [event["detail"]["cause"] for event in events(tmp_path) if event["event"] == "failsafe_over"] == [
        "low battery"
    ]
