"""What sources of targets send: NMEA, lines of gpsd, events of Cursor on Target."""

import json
from functools import reduce
from operator import xor
from typing import Any, Final

PLACE: Final = "4723.8637,N,00832.7352,E"
LATITUDE_DEG: Final = 47 + 23.8637 / 60
LONGITUDE_DEG: Final = 8 + 32.7352 / 60


def sentence(body: str) -> bytes:
    """With its checksum."""
    return f"${body}*{reduce(xor, body.encode()):02X}\r\n".encode()


def gga(time: str, quality: str = "1", place: str = PLACE, hdop: str = "0.9", height: str = "488.2") -> bytes:
    return sentence(f"GNGGA,{time},{place},{quality},12,{hdop},{height},M,47.1,M,,")


def rmc(time: str, status: str = "A", date: str = "291126", speed: str = "10.0", mode: str = "A") -> bytes:
    return sentence(f"GNRMC,{time},{status},{PLACE},{speed},90.0,{date},,,{mode},V")


def gst(time: str) -> bytes:
    return sentence(f"GNGST,{time},2.0,,,,1.1,1.3,2.2")


def tpv(**changes: object) -> bytes:
    """A report of gpsd; None leaves a field out."""
    fields: dict[str, Any] = {
        "class": "TPV",
        "device": "/dev/ttyUSB0",
        "mode": 3,
        "time": "2026-11-29T12:00:00.500Z",
        "lat": 47.4,
        "lon": 8.5,
        "altMSL": 488.0,
        "track": 90.0,
        "speed": 5.0,
        "climb": 0.5,
        "epx": 1.96,
        "epy": 3.92,
        "epv": 7.84,
        "eps": 0.98,
        **changes,
    }
    return json.dumps({key: value for key, value in fields.items() if value is not None}).encode() + b"\r\n"


def cot(uid: str = "X1", callsign: str = "BOAT", **changes: str) -> bytes:
    """An event; `detail` is its inside."""
    fields = {
        "type": "a-f-S",
        "time": "2026-11-29T12:00:00.500Z",
        "lat": "47.4",
        "lon": "8.5",
        "hae": "535.0",
        "ce": "4.5",
        "le": "9.0",
        "detail": f'<contact callsign="{callsign}"/><track course="90.0" speed="5.0"/>',
        **changes,
    }
    point = " ".join(f'{key}="{fields[key]}"' for key in ("lat", "lon", "hae", "ce", "le"))
    head = f'uid="{uid}" type="{fields["type"]}" time="{fields["time"]}"'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><event version="2.0" {head} start="" stale="" how="m-g">'
        f"<point {point}/><detail>{fields['detail']}</detail></event>"
    ).encode()
