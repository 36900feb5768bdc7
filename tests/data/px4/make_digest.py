"""Make digest_*.json.gz from a .tlog that a ground station recorded beside a PX4 or an ArduPilot.

    python make_digest.py session.tlog digest_session.json.gz
    python make_digest.py session.tlog digest_session.json.gz ardupilotmega

`streams`: per message of the vehicle, how many a second, one example from the middle of the recording, and
the fields that never changed. `orders`: what the ground station sent, as [time_s, index into
`order_kinds`]. `replies`: what the vehicle said to it: [time_s, kind, values].
"""

from __future__ import annotations

import gzip
import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

from pymavlink import mavutil

STATION, OTHER_STATIONS = 245, {254, 255}
UNNAMED = -2  # not in the dialect
BAD_DATA = -1  # console text of a starting ArduPilot


def read(path: str, dialect: str) -> list[tuple[float, Any]]:
    """Every message with its time from the first one."""
    log = mavutil.mavlink_connection(path, dialect=dialect)
    messages: list[tuple[float, Any]] = []
    start_s = None
    while (message := log.recv_msg()) is not None:
        start_s = message._timestamp if start_s is None else start_s
        if message.get_msgId() not in {UNNAMED, BAD_DATA}:
            messages.append((message._timestamp - start_s, message))
    return messages


def fields_of(message: Any) -> dict[str, Any]:
    fields = message.to_dict()
    del fields["mavpackettype"]
    return dict(fields)


def digest_streams(messages: list[tuple[float, Any]]) -> dict[str, Any]:
    by_name: dict[str, list[tuple[float, Any]]] = defaultdict(list)
    for time_s, message in messages:
        if message.get_srcSystem() not in {STATION, *OTHER_STATIONS}:
            by_name[message.get_type()].append((time_s, message))
    streams = {}
    for name, seen in sorted(by_name.items()):
        span_s = seen[-1][0] - seen[0][0]
        examples = [fields_of(message) for _, message in seen]
        middle = examples[len(examples) // 2]
        streams[name] = {
            "rate_hz": round((len(seen) - 1) / span_s, 3) if span_s > 0 else 0.0,
            "example": middle,
            "constant": [key for key in middle if len({str(example[key]) for example in examples}) == 1],
        }
    return streams


def digest_replies(messages: list[tuple[float, Any]]) -> list[Any]:
    replies: list[Any] = []
    last: dict[str, Any] = {}
    for time_s, message in messages:
        kind = message.get_type()
        if message.get_srcSystem() in {STATION, *OTHER_STATIONS}:
            continue
        if kind == "HEARTBEAT":
            values = [message.base_mode, message.custom_mode, message.system_status]
        elif kind == "EXTENDED_SYS_STATE":
            values = [message.landed_state]
        elif kind == "COMMAND_ACK":
            replies.append([round(time_s, 3), kind, [message.command, message.result]])
            continue
        elif kind == "STATUSTEXT":
            replies.append([round(time_s, 3), kind, [message.severity, message.text, message.chunk_seq]])
            continue
        else:
            continue
        if last.get(kind) != values:
            replies.append([round(time_s, 3), kind, values])
            last[kind] = values
    return replies


def digest_orders(messages: list[tuple[float, Any]]) -> tuple[list[Any], list[Any]]:
    kinds: dict[str, int] = {}
    orders = []
    for time_s, message in messages:
        if message.get_srcSystem() == STATION:
            key = json.dumps([message.get_msgId(), fields_of(message)])
            orders.append([round(time_s, 3), kinds.setdefault(key, len(kinds))])
    return [json.loads(key) for key in kinds], orders


def main() -> None:
    messages = read(sys.argv[1], *(sys.argv[3:] or ["common"]))
    order_kinds, orders = digest_orders(messages)
    digest = {
        "streams": digest_streams(messages),
        "order_kinds": order_kinds,
        "orders": orders,
        "replies": digest_replies(messages),
    }
    raw = json.dumps(digest, separators=(",", ":")).encode()
    Path(sys.argv[2]).write_bytes(gzip.compress(raw, 9, mtime=0))


if __name__ == "__main__":
    main()
