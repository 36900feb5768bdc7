"""How the frames of an autopilot follow each other: by its boot clock and its sequence numbers. Pure.

An autopilot goes on counting both when its address changes in flight. Another one with the same system id
does not, unless by chance or by an attacker that reads the frames.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink import codec
from gcs.mavlink.framing import ATTITUDE, GLOBAL_POSITION_INT, LOCAL_POSITION_NED, SYSTEM_TIME
from gcs.mavlink.kernels import LENGTH, MAGIC_2, MESSAGE, PAYLOAD, Bytes, Number, Whole
from gcs.model.jit import kernel_within
from gcs.model.state import Array

CLOCK_OFF_S: Final = 1.0
"""Between what a boot clock shows and what is expected of it: a datagram may be late."""

CLOCK_RATE_OFF: Final = 0.02
"""A simulator's clock loses as much on a busy machine."""

STRAYS_S: Final = 1.0
"""Late datagrams do not fit the newest ones, and are left out. What has not fitted for so long is new: the
autopilot has restarted.
"""

EXPECTED: Final = 2
"""An address without this many messages that were expected has fallen silent."""

SILENT_MAX_S: Final = 1.5
"""It has in any case, whatever was expected: before `operation.silence_s` has passed."""

NUMBERS: Final = 256
MOST: Final = 2.0
"""Times as many frames as expected may have been sent."""

SPARE_NUMBERS: Final = 16
"""Frames that an autopilot may send at once besides its streams, such as answers."""

_SHARE: Final = 0.2  # of a new measurement in the averages
_MEASURED_S: Final = 0.05  # least time over which rates are measured


def _boot_clocks() -> NDArray[np.int16]:
    """By message id, where its payload has the boot clock in ms; -1: it has none that counts."""
    having = (SYSTEM_TIME, ATTITUDE, LOCAL_POSITION_NED, GLOBAL_POSITION_INT)
    at = np.full(max(having) + 1, -1, np.int16)
    for message_id in having:
        at[message_id] = codec.offset(message_id, "time_boot_ms")
    return at


BOOT_AT: Final = _boot_clocks()
NO_CLOCK: Final = -1


class Continuity(NamedTuple):
    """What the newest frames of n autopilots lead to expect of the next ones; written in place."""

    sequence: Whole  # (n,) number of the newest frame
    sequence_s: Array  # its arrival, -inf before
    clock_base_s: Array  # arrival minus boot clock, NaN before
    measured_s: Array  # when the next two were measured last, -inf before
    measured_at: Whole  # the sequence number then
    period_s: Array  # between messages with a boot clock
    frames_hz: Array  # all frames

    @staticmethod
    def unknown(n: int) -> "Continuity":
        """Nothing received: a few frames a second are expected."""
        return Continuity(
            sequence=np.zeros(n, np.int64),
            sequence_s=np.full(n, -np.inf),
            clock_base_s=np.full(n, np.nan),
            measured_s=np.full(n, -np.inf),
            measured_at=np.zeros(n, np.int64),
            period_s=np.full(n, 0.5),
            frames_hz=np.full(n, 50.0),
        )


class Counted(NamedTuple):
    """What one frame counts."""

    number: int
    boot_ms: int  # NO_CLOCK: its message has no boot clock


@kernel_within
def number_of(data: Bytes, begin: Number) -> np.int64:
    """Sequence number of the frame that begins there."""
    return np.int64(data[begin + 4] if data[begin] == MAGIC_2 else data[begin + 2])


@kernel_within
def boot_ms_of(data: Bytes, frame: Whole) -> np.int64:
    """Boot clock of a frame (FRAME_COLUMNS,), or NO_CLOCK."""
    message = frame[MESSAGE]
    at = BOOT_AT[message] if message < len(BOOT_AT) else NO_CLOCK
    boot_ms = np.int64(NO_CLOCK if at < 0 else 0)
    if at >= 0:
        place = frame[PAYLOAD] + at
        for byte in range(min(4, frame[PAYLOAD] + frame[LENGTH] - place)):
            boot_ms |= np.int64(data[place + byte]) << (8 * byte)
    return boot_ms


@kernel_within
def note_frame(number: np.int64, boot_ms: np.int64, row: Number, time_s: float, into: Continuity) -> None:
    """Take a frame of the autopilot in `row`, unless it is a late one."""
    passed_s, measured_for_s = time_s - into.sequence_s[row], time_s - into.measured_s[row]
    off_s = time_s - boot_ms * 1e-3 - into.clock_base_s[row]
    has_clock, fits = boot_ms != NO_CLOCK, abs(off_s) <= CLOCK_OFF_S
    is_late = has_clock and not fits and measured_for_s <= STRAYS_S
    ahead = (number - into.sequence[row]) % NUMBERS
    may_follow = 0 < ahead <= SPARE_NUMBERS + MOST * into.frames_hz[row] * passed_s
    if not is_late and (may_follow or not passed_s <= STRAYS_S):
        into.sequence[row] = number
        into.sequence_s[row] = time_s
    if has_clock and not is_late:
        into.clock_base_s[row] = into.clock_base_s[row] + _SHARE * off_s if fits else time_s - boot_ms * 1e-3
        if measured_for_s >= _MEASURED_S:
            count = (into.sequence[row] - into.measured_at[row]) % NUMBERS
            into.period_s[row] += _SHARE * (min(measured_for_s, SILENT_MAX_S) - into.period_s[row])
            into.frames_hz[row] += _SHARE * (count / measured_for_s - into.frames_hz[row])
            into.measured_s[row] = time_s
            into.measured_at[row] = into.sequence[row]


def is_silent(of: Continuity, row: int, time_s: float) -> bool:
    """Whether the autopilot in `row` has sent nothing for as long as two messages were expected."""
    expected_s = min(EXPECTED * float(of.period_s[row]), SILENT_MAX_S)
    return bool(time_s - of.sequence_s[row] >= expected_s)


def follows(of: Continuity, row: int, frame: Counted, time_s: float) -> bool:
    """Whether a frame that arrived at `time_s` may be the next one, or one soon after, of this autopilot.

    Its number lies within `MOST` times what was expected, and its boot clock, if it has one, has gone on.
    """
    passed_s = time_s - float(of.sequence_s[row])
    most = SPARE_NUMBERS + MOST * float(of.frames_hz[row]) * passed_s
    ahead = (frame.number - int(of.sequence[row])) % NUMBERS
    if not (1 <= ahead <= most or most >= NUMBERS):
        return False
    if frame.boot_ms == NO_CLOCK:
        return True
    off_s = time_s - frame.boot_ms * 1e-3 - float(of.clock_base_s[row])
    return abs(off_s) <= CLOCK_OFF_S + CLOCK_RATE_OFF * passed_s
