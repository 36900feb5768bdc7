from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as dialect

from gcs.mavlink.codec import encode, kill_message, split, target_system
from gcs.mavlink.framing import COMMAND_LONG, SETPOINT_MESSAGES, Frame, is_armed, moves, status_text

PACKER = dialect.MAVLink(None, srcSystem=7, srcComponent=1)


def framed(message: Any, *, version_1: bool = False) -> bytes:
    return bytes(message.pack(PACKER, force_mavlink1=version_1))


def only(data: bytes) -> Frame:
    frames, garbage, _ = split(data)
    assert garbage == 0
    (frame,) = frames
    return frame


def beat(
    base_mode: int = 1, custom_mode: int = 4 << 16 | 3 << 24, autopilot: int = 12, system_status: int = 4
) -> Any:
    return dialect.MAVLink_heartbeat_message(2, autopilot, base_mode, custom_mode, system_status, 3)


def setpoint(target: int) -> Any:
    return dialect.MAVLink_set_position_target_local_ned_message(
        0, target, 1, 1, 0x9C7, 0, 0, 0, 1.0, 2.0, 3.0, 0, 0, 0, 0, 0
    )


@pytest.mark.parametrize("version_1", [False, True])
def test_datagram_of_several_frames_is_split(version_1: bool) -> None:
    parts = [framed(beat(), version_1=version_1), framed(setpoint(3), version_1=version_1)]
    frames, garbage, _ = split(b"".join(parts))
    assert garbage == 0
    assert [frame.raw for frame in frames] == parts
    assert [frame.message_id for frame in frames] == [0, 84]
    assert {(frame.system_id, frame.component_id) for frame in frames} == {(7, 1)}


def test_a_signed_frame_keeps_its_signature() -> None:
    signer = dialect.MAVLink(None, srcSystem=7, srcComponent=1)
    signer.signing.secret_key = b"k" * 32
    signer.signing.sign_outgoing = True
    data = bytes(beat().pack(signer))
    assert only(data).raw == data
    assert len(data) > len(framed(beat()))


def test_noise_around_frames_is_counted_and_skipped() -> None:
    one, two = framed(beat()), framed(setpoint(3))
    frames, garbage, _ = split(b"\xfd\x00" + one + b"\xfe" + two + two[:-1])
    assert [frame.raw for frame in frames] == [one, two]
    assert garbage == 2 + 1 + len(two) - 1


def test_unknown_message_is_skipped_whole() -> None:
    known = framed(beat())
    unknown = known[:7] + (410).to_bytes(3, "little") + known[10:]
    frames, garbage, unknown_bytes = split(known + unknown + known + unknown)
    assert [frame.raw for frame in frames] == [known, known]
    assert (garbage, unknown_bytes) == (0, 2 * len(unknown))


def test_a_flipped_bit_makes_garbage_of_a_frame() -> None:
    data = bytearray(framed(beat()))
    data[10] ^= 1
    assert split(bytes(data)) == ([], len(data), 0)


def test_target_is_found_in_every_message_layout() -> None:
    offsets_seen = set()
    for message_id, kind in dialect.mavlink_map.items():
        if "target_system" not in kind.fieldnames:
            continue
        values: list[Any] = []
        lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
        for name, code in zip(kind.fieldnames, kind.fieldtypes, strict=True):
            single: Any = b"x" if code == "char" else 1
            values.append(123 if name == "target_system" else _filled(single, lengths[name]))
        frame = only(framed(kind(*values)))
        assert frame.message_id == message_id
        assert target_system(frame) == 123, kind.msgname
        offsets_seen.add(frame.payload.index(123))
    assert len(offsets_seen) > 5


def _filled(single: Any, length: int) -> Any:
    if length == 0:
        return single
    return single * length if isinstance(single, bytes) else [single] * length


def test_target_truncated_with_trailing_zeros_is_broadcast() -> None:
    command = dialect.MAVLink_command_long_message(0, 0, 512, 0, 0, 0, 0, 0, 0, 0, 0)
    frame = only(framed(command))
    assert len(frame.payload) == 30
    assert target_system(frame) == 0


def test_every_message_that_steers_is_governed_and_has_a_target() -> None:
    names = {dialect.mavlink_map[message_id].msgname for message_id in SETPOINT_MESSAGES}
    steering = {
        kind.msgname
        for kind in dialect.mavlink_map.values()
        if kind.msgname.startswith(("SET_POSITION_TARGET", "SET_ATTITUDE_TARGET", "SET_ACTUATOR"))
    }
    assert names == steering | {"MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE"}


def test_manual_control_is_addressed_by_its_own_field() -> None:
    frame = only(framed(dialect.MAVLink_manual_control_message(9, 1, 1, 1, 1, 1)))
    assert target_system(frame) == 9


def test_status_text_ends_at_zero_or_continues_in_a_chunk() -> None:
    short = status_text(only(framed(dialect.MAVLink_statustext_message(4, b"hello"))))
    assert (short.text, short.last) == (b"hello", True)
    long = status_text(only(framed(dialect.MAVLink_statustext_message(4, b"x" * 50, id=3, chunk_seq=0))))
    assert (len(long.text), long.last) == (50, False)


def test_commands_that_move_a_vehicle_differ_from_queries() -> None:
    def command(number: int) -> Frame:
        return only(framed(dialect.MAVLink_command_long_message(5, 1, number, 0, 1, 0, 0, 0, 0, 0, 0)))

    assert moves(command(400))
    assert moves(command(176))
    assert moves(only(framed(setpoint(5))))
    assert moves(only(framed(dialect.MAVLink_set_mode_message(5, 1, 0))))
    assert not moves(command(512))
    assert not moves(only(framed(beat())))


def test_kill_command_is_the_one_px4_obeys_in_flight() -> None:
    frames = encode(COMMAND_LONG, kill_message(5), np.array([44], np.uint8))
    data = frames.data[0, : frames.length[0]].tobytes()
    assert target_system(only(data)) == 5
    (message,) = dialect.MAVLink(None).parse_buffer(data)
    assert (message.command, message.param1, message.param2) == (400, 0, 21196)
    assert (message.get_srcSystem(), message.get_srcComponent()) == (254, 190)


@pytest.mark.parametrize(("base_mode", "armed"), [(0x81, True), (0x80, True), (0x01, False), (0, False)])
def test_a_heartbeat_reports_arming(base_mode: int, armed: bool) -> None:
    assert is_armed(only(framed(beat(base_mode=base_mode)))) is armed
    assert not is_armed(only(framed(beat(base_mode=base_mode)))._replace(payload=b""))
