import json
import logging
import sys
from datetime import UTC, datetime
from pathlib import Path

from gcs.cli.service import process
from gcs.service.access import Denied


def line(level: int, message: str, *arguments: object, **extra: object) -> dict[str, object]:
    record = logging.getLogger("gcs.test").makeRecord(
        "gcs.test", level, "f.py", 1, message, arguments, None, extra=extra
    )
    text = process.JsonLines().format(record)
    assert "\n" not in text
    read: dict[str, object] = json.loads(text)
    return read


def test_line_has_time_level_logger_event_and_fields() -> None:
    before = datetime.now(UTC)
    read = line(logging.WARNING, "link_failed", link="north", cause="no\nroute", files=[Path("a")])
    assert list(read) == ["time", "level", "logger", "event", "link", "cause", "files"]
    assert abs((datetime.fromisoformat(str(read.pop("time"))) - before).total_seconds()) < 5.0
    assert read == {
        "level": "warning",
        "logger": "gcs.test",
        "event": "link_failed",
        "link": "north",
        "cause": "no\nroute",
        "files": ["a"],
    }


def test_arguments_are_formatted_and_odd_values_are_safe() -> None:
    read = line(logging.INFO, "%s of %d", "two", 3, value=float("nan"), denied=Denied)
    assert read["event"] == "two of 3"


def test_a_traceback_stays_on_its_line() -> None:
    try:
        int("boom")
    except ValueError:
        record = logging.getLogger("gcs").makeRecord("gcs", logging.ERROR, "f", 1, "bug", (), sys.exc_info())
    read = json.loads(process.JsonLines().format(record))
    assert "ValueError: invalid literal" in read["traceback"]
    assert "exc_info" not in read
