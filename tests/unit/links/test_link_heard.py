from math import inf
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from gcs.links.heard import Heard
from gcs.links.mavlink_frames import split
from gcs.state import Mode


def take(heard: Heard, time_s: float, *messages: Any, component: int = 1) -> None:
    packer = dialect.MAVLink(None, srcSystem=1, srcComponent=component)
    for message in messages:
        for frame in split(bytes(message.pack(packer))).frames:
            heard.take(frame, time_s)


def beat(autopilot: int = 12) -> Any:
    return dialect.MAVLink_heartbeat_message(2, autopilot, 0x81, 6 << 16, 4, 3)


def position() -> Any:
    return dialect.MAVLink_global_position_int_message(0, 1, 2, 3, 4, 5, 6, 7, 8)


def text(part: bytes, text_id: int = 0, chunk: int = 0) -> Any:
    return dialect.MAVLink_statustext_message(4, part, text_id, chunk)


def test_nothing_was_heard_before_the_first_frame() -> None:
    heard = Heard()
    assert (heard.time_s, heard.heartbeat_time_s, heard.position_time_s) == (-inf, -inf, -inf)
    assert (heard.armed, heard.mode, heard.prearm_ok) == (False, Mode.UNKNOWN, False)


def test_heartbeats_and_positions_have_times_of_their_own() -> None:
    heard = Heard()
    take(heard, 1.0, beat())
    take(heard, 2.0, position())
    assert (heard.time_s, heard.heartbeat_time_s, heard.position_time_s) == (2.0, 1.0, 2.0)
    assert (heard.armed, heard.mode) == (True, Mode.OFFBOARD)


def test_a_camera_on_board_does_not_speak_for_the_autopilot() -> None:
    heard = Heard()
    take(heard, 1.0, beat(), position(), component=100)
    take(heard, 1.5, beat(autopilot=8))
    assert (heard.heartbeat_time_s, heard.position_time_s) == (-inf, -inf)
    assert heard.mode is Mode.UNKNOWN
    assert heard.time_s == 1.5


def test_a_heartbeat_is_news() -> None:
    heard = Heard()
    waiting = heard.news
    take(heard, 1.0, position())
    assert not waiting.is_set()
    take(heard, 1.0, beat())
    assert waiting.is_set()
    assert not heard.news.is_set()


def test_a_long_text_is_put_together_from_its_chunks() -> None:
    heard = Heard()
    take(heard, 1.0, text(b"a" * 50, 9, 0), text(b"b" * 50, 9, 1), text(b"end", 9, 2))
    assert heard.text == "a" * 50 + "b" * 50 + "end"
    take(heard, 2.0, text(b"next"))
    assert (heard.text, heard.text_time_s) == ("next", 2.0)


def test_endless_chunks_stay_bounded() -> None:
    heard = Heard()
    for chunk in range(200):
        take(heard, 1.0, text(b"a" * 50, 9, chunk))
    assert len(heard.text) == 8 * 50
