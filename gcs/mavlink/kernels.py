"""Compiled loops over bytes: frames in datagrams, frames around payloads. No I/O.

Formats: https://mavlink.io/en/guide/serialization.html. The checksum is CRC-16/MCRF4XX over everything but
the first byte, then over the CRC extra byte of the message's definition.
"""

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel, kernel_within

Bytes: TypeAlias = NDArray[np.uint8]
Whole: TypeAlias = NDArray[np.int64]
Number: TypeAlias = int | np.int64

FRAME_COLUMNS: Final = 8
"""Columns that `find_frames` writes: datagram, message, system, component, start of the payload, its length,
start of the frame, its end (signature included).
"""

DATAGRAM, MESSAGE, SYSTEM, COMPONENT, PAYLOAD, LENGTH, BEGIN, END = range(FRAME_COLUMNS)

SHORTEST_FRAME: Final = 8
LONGEST_FRAME: Final = 280

MAGIC_1: Final = 0xFE
MAGIC_2: Final = 0xFD
SIGNED: Final = 0x01
SIGNATURE_LENGTH: Final = 13


def _tables() -> NDArray[np.uint16]:
    """Effect of one byte on the checksum, with 0 to 3 bytes after it: (4, 256)."""
    table = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        table = np.where(table & 1, table >> 1 ^ 0x8408, table >> 1).astype(np.uint16)
    tables = [table]
    for _ in range(3):
        tables.append(tables[-1] >> 8 ^ table[tables[-1] & 0xFF])
    return np.array(tables, np.uint16)


_CRC: Final = _tables()

_CHECKED_MAX: Final = 264
"""Bytes of the longest frame that its checksum covers: 9 of the header, 255 of the payload."""

_DIRECT: Final = 2
"""Bytes that are checked frame by frame for each byte of a datagram. Frames that are right need one."""


def _shifts() -> NDArray[np.uint16]:
    """What 0 to _CHECKED_MAX zeros make of each half byte of the checksum before them: (265, 4, 16)."""
    shifts = [np.arange(16, dtype=np.uint16) << np.arange(0, 16, 4, dtype=np.uint16)[:, None]]
    for _ in range(_CHECKED_MAX):
        shifts.append(shifts[-1] >> 8 ^ _CRC[0, shifts[-1] & 0xFF])
    return np.array(shifts, np.uint16)


_SHIFTS: Final = _shifts()


@kernel
def checksum(data: Bytes, start: Number, end: Number, extra: Number) -> np.int64:
    """CRC-16/MCRF4XX over ``data[start:end]`` and then one byte `extra`; four bytes at a time."""
    crc = np.int64(0xFFFF)
    whole = start + (end - start) // 4 * 4
    for at in range(start, whole, 4):
        crc ^= np.int64(data[at]) | np.int64(data[at + 1]) << 8
        ahead = np.int64(_CRC[3, crc & 0xFF]) ^ np.int64(_CRC[2, crc >> 8])
        crc = ahead ^ np.int64(_CRC[1, data[at + 2]]) ^ np.int64(_CRC[0, data[at + 3]])
    for at in range(whole, end):
        crc = crc >> 8 ^ np.int64(_CRC[0, (crc ^ np.int64(data[at])) & 0xFF])
    return crc >> 8 ^ np.int64(_CRC[0, (crc ^ extra) & 0xFF])


@kernel_within
def _checksum_within(
    data: Bytes, begin: Number, end: Number, start: Number, last: Number, extra: Number, sums: Whole
) -> np.int64:
    """As `checksum` over ``data[start:last]``, for any number of places in one datagram.

    Bytes that all look like the beginning of a frame would be summed up 260 times each. Where many frames are
    wrong, the sums up to each byte are formed once, and a frame's is found from two of them: it is linear.

    Args:
        data: buffer that contains the datagram.
        begin: of the datagram.
        end: of the datagram.
        start: first byte.
        last: the byte behind the last one.
        extra: the CRC extra byte.
        sums: (end - begin + 2,) at first how many bytes may be summed up frame by frame; changed.
    """
    if sums[0] >= 0:
        sums[0] -= last - start
        if sums[0] >= 0:
            return checksum(data, start, last, extra)
        sums[1] = 0
        for at in range(end - begin):
            sums[at + 2] = sums[at + 1] >> 8 ^ np.int64(_CRC[0, (sums[at + 1] ^ data[begin + at]) & 0xFF])
    crc: np.int64
    before, crc = sums[start - begin + 1] ^ 0xFFFF, sums[last - begin + 1]
    for half in range(4):
        crc ^= np.int64(_SHIFTS[last - start, half, before >> 4 * half & 0xF])
    return crc >> 8 ^ np.int64(_CRC[0, (crc ^ extra) & 0xFF])


@kernel_within
def _message_id(data: Bytes, start: Number) -> np.int64:
    if data[start] == MAGIC_1:
        return np.int64(data[start + 5])
    return np.int64(data[start + 7]) | np.int64(data[start + 8]) << 8 | np.int64(data[start + 9]) << 16


@kernel_within
def _reach(data: Bytes, start: Number, end: Number) -> Number:
    """End of the frame with its header at `start`, after `end` where it is not whole; 0: none begins."""
    room = end - start
    if data[start] == MAGIC_1:
        return start + 8 + np.int64(data[start + 1]) if room > 1 else end + 1
    if data[start] != MAGIC_2:
        return np.int64(0)
    if room < 3:
        return end + 1
    flags = np.int64(data[start + 2])
    if flags & ~SIGNED:
        return np.int64(0)  # unknown flags may change everything that follows
    return start + 12 + np.int64(data[start + 1]) + (SIGNATURE_LENGTH if flags else 0)


@kernel_within
def _behind(
    data: Bytes, begin: Number, end: Number, start: Number, extras: NDArray[np.int16], sums: Whole
) -> Number:
    """End of the frame that begins at `start`; 0 when there is none, whole and with the right checksum.

    Negative: end of a possible frame of an unknown message: its checksum cannot be verified. The datagram
    is from `begin` to `end`; `sums` as of `_checksum_within`.
    """
    reach = _reach(data, start, end)
    if reach == 0 or reach > end:
        return np.int64(0)
    message = _message_id(data, start)
    extra = extras[message] if message < len(extras) else -1
    if extra < 0:
        return -reach
    last = start + 12 + np.int64(data[start + 1]) if data[start] == MAGIC_2 else reach
    reported = np.int64(data[last - 2]) | np.int64(data[last - 1]) << 8
    computed = _checksum_within(data, begin, end, start + 1, last - 2, extra, sums)
    return reach if computed == reported else np.int64(0)


@kernel
def longest(lengths: Whole) -> Number:
    """The greatest length; 0 of none."""
    most: Number
    most = np.int64(0)
    for length in lengths:
        most = max(most, length)
    return most


@kernel
def find_frames(
    data: Bytes, starts: Whole, lengths: Whole, extras: NDArray[np.int16]
) -> tuple[Whole, int, int]:
    """Find frames in datagrams. Never fails, whatever the bytes.

    Args:
        data: buffer that contains the datagrams.
        starts: (m,) of each.
        lengths: (m,) in bytes.
        extras: by message id, the CRC extra byte; -1: not known.

    Returns: (k, FRAME_COLUMNS); bytes of garbage; bytes of messages that cannot be checked.
    """
    count, garbage, unknown = 0, 0, 0
    frames = np.empty((lengths.sum() // SHORTEST_FRAME + 1, FRAME_COLUMNS), np.int64)
    sums = np.empty(longest(lengths) + 2, np.int64)
    place: Number
    unknown_end: Number
    for datagram in range(len(starts)):
        place = begin = starts[datagram]
        end = place + lengths[datagram]
        sums[0] = _DIRECT * lengths[datagram]
        unknown_end = 0
        while place < end:
            behind = _behind(data, begin, end, place, extras, sums)
            if behind > 0:
                is_new = data[place] == MAGIC_2
                header = 10 if is_new else 6
                row = frames[count]
                row[0] = datagram
                row[1] = _message_id(data, place)
                row[2] = data[place + 5] if is_new else data[place + 3]
                row[3] = data[place + 6] if is_new else data[place + 4]
                row[4] = place + header
                row[5] = data[place + 1]
                row[6] = place
                row[7] = behind
                count += 1
                place = behind
                continue
            if behind < 0 and (-behind == end or data[-behind] in (MAGIC_1, MAGIC_2)):
                unknown_end = -behind
            # Only one byte further: length and message themselves may be wrong, and hide a good frame.
            if place < unknown_end:
                unknown += 1
            else:
                garbage += 1
            place += 1
    return frames[:count], garbage, unknown


@kernel
def whole_until(data: Bytes, begin: Number, end: Number, extras: NDArray[np.int16], sums: Whole) -> Number:
    """End of what can be read of a stream: the first place that may begin a frame that is not whole yet.

    Args:
        data: buffer that contains what has arrived.
        begin: of it.
        end: of it.
        extras: as of `find_frames`.
        sums: (end - begin + 2,) written.
    """
    place: Number
    place = begin
    sums[0] = _DIRECT * (end - begin)
    while place < end:
        if _reach(data, place, end) > end:
            return place
        behind = _behind(data, begin, end, place, extras, sums)
        place = behind if behind > 0 else place + 1
    return end


@kernel
def ends_with_a_frame(
    data: Bytes, begin: Number, end: Number, extras: NDArray[np.int16], sums: Whole
) -> bool:
    """Whether bytes are frames end to end by their headers, and the last has the right checksum.

    Nothing can then be missing behind them. Costs little, and the arguments are those of `whole_until`.
    """
    place: Number
    last: Number
    place = last = begin
    while place < end:
        reach = _reach(data, place, end)
        if reach == 0 or reach > end:
            return False
        place, last = reach, place
    sums[0] = _CHECKED_MAX
    return bool(begin < end and _behind(data, last, end, last, extras, sums) > 0)


@kernel
def cut_out(data: Bytes, starts: Whole, lengths: Whole, payloads: Bytes) -> None:
    """Copy payloads to the rows of `payloads` (k, size), padded with the zeros that MAVLink 2 leaves out."""
    size = payloads.shape[1]
    for row in range(len(starts)):
        length = min(lengths[row], size)
        for place in range(length):
            payloads[row, place] = data[starts[row] + place]
        for place in range(length, size):
            payloads[row, place] = 0


@kernel
def put_frames(
    payloads: Bytes,
    message: int,
    extra: int,
    sequence: Bytes,
    system: Bytes,
    component: int,
    frames: Bytes,
    lengths: Whole,
) -> None:
    """Make a MAVLink 2 frame of every payload, without the zeros at its end (at least one byte stays).

    Args:
        payloads: (n, size).
        message: its id.
        extra: the CRC extra byte.
        sequence: (n,) numbers of the frames.
        system: (n,) of the senders.
        component: of the sender.
        frames: (n, at least size + 12), written.
        lengths: (n,) of the frames, written.
    """
    for row in range(len(payloads)):
        length = payloads.shape[1]
        while length > 1 and payloads[row, length - 1] == 0:
            length -= 1
        frame = frames[row]
        frame[0] = MAGIC_2
        frame[1] = length
        frame[2] = 0
        frame[3] = 0
        frame[4] = sequence[row]
        frame[5] = system[row]
        frame[6] = component
        frame[7] = message & 0xFF
        frame[8] = message >> 8 & 0xFF
        frame[9] = message >> 16 & 0xFF
        for place in range(length):
            frame[10 + place] = payloads[row, place]
        crc = checksum(frame, 1, 10 + length, extra)
        frame[10 + length] = crc & 0xFF
        frame[11 + length] = crc >> 8
        lengths[row] = 12 + length
