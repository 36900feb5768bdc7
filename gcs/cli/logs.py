"""Structured logs: one JSON line per change of state, on standard error."""

import logging
import sys
from typing import Any, Final

from pythonjsonlogger.json import JsonFormatter

FIELDS: Final = {"levelname": "level", "name": "logger", "message": "event", "exc_info": "traceback"}


class JsonLines(JsonFormatter):
    """Formats time, level, logger, event, and the caller's extra fields."""

    def __init__(self) -> None:
        super().__init__(
            ["levelname", "name", "message"], timestamp="time", rename_fields=FIELDS, json_default=str
        )

    def process_log_record(self, log_data: dict[str, Any]) -> dict[str, Any]:
        """Put the time first, in milliseconds; levels are in lower case."""
        time = log_data.pop("time").isoformat(timespec="milliseconds")
        return {"time": time, **log_data, "level": log_data["level"].lower()}


OURS = ("gcs",)


def set_up(level: int) -> None:
    """Log this project's packages from `level`, and others' warnings. A record may receive lower levels."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines())
    handler.addFilter(lambda record: record.levelno >= level or record.name.split(".")[0] not in OURS)
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(logging.WARNING)
    for name in OURS:
        logging.getLogger(name).setLevel(level)
