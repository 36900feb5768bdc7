"""Structured logs: one line of JSON per change of state, on standard error."""

import logging
import sys
from typing import Any, Final

from pythonjsonlogger.json import JsonFormatter

FIELDS: Final = {"levelname": "level", "name": "logger", "message": "event", "exc_info": "traceback"}


class JsonLines(JsonFormatter):
    """Time, level, logger, event, and whatever the caller added."""

    def __init__(self) -> None:
        super().__init__(
            ["levelname", "name", "message"], timestamp="time", rename_fields=FIELDS, json_default=str
        )

    def process_log_record(self, log_data: dict[str, Any]) -> dict[str, Any]:
        """Time first, in milliseconds; levels in small letters."""
        time = log_data.pop("time").isoformat(timespec="milliseconds")
        return {"time": time, **log_data, "level": log_data["level"].lower()}


OURS = ("gcs",)


def set_up(level: int) -> None:
    """Log our own packages from `level`, everybody else's warnings. A record may hear more."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines())
    handler.addFilter(lambda record: record.levelno >= level or record.name.split(".")[0] not in OURS)
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(logging.WARNING)
    for name in OURS:
        logging.getLogger(name).setLevel(level)
