"""When a vehicle's samples were sent: in which order, and how long before they arrived. Compiled.

Bonded links, meshes and cellular networks deliver datagrams late, in another order, and twice. A message with
the autopilot's clock is dated by it; the others by the number of their frame, which MAVLink counts in 8 bits.
A sample older than the newest of its kind is late, and worth nothing.

The clock is continued beyond its 32 bits. A clock that leaves its course is believed once several messages
agree on the new one, and none continues the old one in between: one message alone changes nothing. It is a
restart if the new clock began after the newest sample of the old one; otherwise the clock was set.

Positions that come regularly may still be old. They are late by the difference of their clock to the time of
arrival, over the least that it was; not later than answers to our requests are, because a clock that is set,
or that stands with its simulation, delays no answer. Or they are behind what the vehicle sends beside them.
"""

from typing import Final, NamedTuple

import numpy as np

from gcs.mavlink import framing
from gcs.mavlink.kernels import Number, Whole
from gcs.model.jit import kernel
from gcs.model.state import Array

DATED: Final = (
    framing.GLOBAL_POSITION_INT,
    framing.ATTITUDE,
    framing.LOCAL_POSITION_NED,
    framing.SYSTEM_TIME,
)
"""Messages with the autopilot's clock in milliseconds. ODOMETRY has it in microseconds, or another clock."""

NUMBERED: Final = (
    framing.HEARTBEAT,
    framing.SYS_STATUS,
    framing.BATTERY_STATUS,
    framing.EXTENDED_SYS_STATE,
    framing.GPS_RAW_INT,
    framing.EKF_STATUS_REPORT,
)
"""Messages without it; GPS_RAW_INT has the time of its receiver, of any kind."""

UNJUDGED: Final = -1
POSITION: Final = DATED.index(framing.GLOBAL_POSITION_INT)
TIME: Final = DATED.index(framing.SYSTEM_TIME)
ODOMETRY: Final = len(DATED)
CLOCKED: Final = ODOMETRY + 1
UNDATED_ODOMETRY: Final = CLOCKED + len(NUMBERED)
KINDS: Final = UNDATED_ODOMETRY + 1

_KIND: Final = {message: kind for kind, message in enumerate((*DATED, framing.ODOMETRY, *NUMBERED))}
KIND_OF: Final = np.array([_KIND.get(message, UNJUDGED) for message in range(max(_KIND) + 1)])
"""By message id."""

LATE, GOOD, RESTARTED = range(3)

LATE_MAX_MS: Final = 10_000
"""Further behind the newest, a clock has been set, or has begun anew."""

AHEAD_MAX_MS: Final = 10_000
"""By so much a clock may be ahead of what has passed since its newest sample: that one was late."""

AGREES_MS: Final = 1000
"""Messages agree on a new clock if it runs like ours within this."""

AGREED: Final = 3
AGREED_S: Final = 0.2
"""So many messages, over at least this time: one datagram may contain several."""

BEGUN_S: Final = 0.2
"""Up to this time before the newest sample of the old clock a new one may seem to have begun: links vary."""

NUMBERS_AHEAD: Final = 16
"""Up to so many frames in a row are lost. A number further ahead is that of a late frame."""

ALONE_S: Final = 0.5
"""After a silence of this time any number continues."""

OVERTAKEN_MS: Final = 100
"""A SYSTEM_TIME that other messages overtook by this says nothing about the clocks any more."""

LEAST_OF_S: Final = 0.3
"""Of the positions of so much time, and of as much before it, the least late counts: links vary."""

PROMPT_S, BESIDE_S = 0.1, 0.5
"""An answer that takes so much longer than the soonest of all is prompt, as is a position so long before."""

RATE_AFTER_S, RATE_ANEW_S, RATE_MAX = 20.0, 60.0, 0.05
"""A clock's rate is measured between two prompt positions so far apart: a simulator's loses 2 %."""

REQUESTS: Final = 8
"""So many requests wait for an answer."""

_CLOCK_BITS: Final = np.int64(32)
_NUMBER_MAX: Final = np.int64(0xFF)


class Clocks(NamedTuple):
    """What is known of the order of n vehicles' samples, written in place."""

    clock_ms: Whole  # (n,) newest, continued beyond 32 bits; -1: none
    clock_at_s: Array  # (n,) arrival of the newest
    number: Whole  # (n,) newest of a frame, continued beyond 8 bits; -1: none
    newest: Whole  # (n, KINDS) clock or number of the newest sample of each kind; -1: none
    anew_ms: Whole  # (n,) newest of a clock that is not believed yet
    anew_at_s: Array  # (n,) its arrival
    anew_since_s: Array  # (n,) arrival of the first that agreed
    anew_count: Whole  # (n,) how many agree
    late: Whole  # (n,) samples dropped: late, or of a clock that is not believed
    least_base_s: Array  # (n, 2) of positions, arrival less clock: the least, NaN before; and when it arrived
    rate_base_s: Array  # (n, 2) the same of the prompt position from which the rate is measured; NaN: none
    newest_base_s: Array  # (n, 2) the same of the newest position
    rate: Array  # (n,) by which the difference of arrival and clock grows, where it is measured
    least_late_s: Array  # (n, 2, 2) least late in this window and the one before; by clock, and behind others
    window_s: Array  # (n,) begin of this window
    asked_ns: Whole  # (n, REQUESTS) our time in requests without an answer, the newest last; 0: none
    round_trip_s: Array  # (n,) of the newest answer to one, NaN before
    least_trip_s: Array  # (n,) of all answers, inf before
    clock_late_s: Array  # (n,) newest position, by its clock alone: how late at least
    late_s: Array  # (n,) newest position: how late at least

    @staticmethod
    def unknown(n: int) -> "Clocks":
        """Nothing received."""
        return Clocks(
            clock_ms=np.full(n, -1, np.int64),
            clock_at_s=np.full(n, -np.inf),
            number=np.full(n, -1, np.int64),
            newest=np.full((n, KINDS), -1, np.int64),
            anew_ms=np.full(n, -1, np.int64),
            anew_at_s=np.full(n, -np.inf),
            anew_since_s=np.full(n, -np.inf),
            anew_count=np.zeros(n, np.int64),
            late=np.zeros(n, np.int64),
            least_base_s=np.full((n, 2), np.nan),
            rate_base_s=np.full((n, 2), np.nan),
            newest_base_s=np.full((n, 2), -np.inf),
            rate=np.zeros(n),
            least_late_s=np.full((n, 2, 2), np.inf),
            window_s=np.full(n, -np.inf),
            asked_ns=np.zeros((n, REQUESTS), np.int64),
            round_trip_s=np.full(n, np.nan),
            least_trip_s=np.full(n, np.inf),
            clock_late_s=np.zeros(n),
            late_s=np.zeros(n),
        )

    def position_clock_s(self) -> Array:
        """(n,) the vehicle's clock in its newest position; NaN: it has none."""
        sent_ms = self.newest[:, POSITION]
        return np.where(sent_ms >= 0, 1e-3 * sent_ms, np.nan)


@kernel
def judged(
    row: Number,
    kind: Number,
    clock_ms: Number,
    number: Number,
    time_s: float,
    life_s: float,
    into: Clocks,
) -> int:
    """Judge one frame of a vehicle. Never fails, whatever it contains.

    Args:
        row: the vehicle.
        kind: of its message; UNJUDGED: any other.
        clock_ms: the autopilot's, of 32 bits; -1: the message has none.
        number: of the frame, of 8 bits.
        time_s: of arrival.
        life_s: arrival of the vehicle's newest frame before, -inf: none.
        into: written.

    Returns: LATE, GOOD, or RESTARTED, where this message is the one by which a restart is believed.
    """
    newest = into.number[row]
    ahead = (number - newest) & _NUMBER_MAX
    goes_on = newest < 0 or not time_s - life_s <= ALONE_S or ahead <= NUMBERS_AHEAD
    verdict, advances = GOOD, goes_on
    if clock_ms >= 0:
        verdict, advances = _by_clock(row, kind, clock_ms, time_s, goes_on, goes_on and ahead > 0, into)
    if newest < 0:
        into.number[row] = number
    elif advances:
        into.number[row] = newest + ahead
    if clock_ms < 0 and kind != UNJUDGED:
        if kind == ODOMETRY:
            kind = UNDATED_ODOMETRY
        sent = into.number[row] if goes_on else newest + ahead - _NUMBER_MAX - 1
        if sent < into.newest[row, kind]:
            verdict = LATE
        else:
            into.newest[row, kind] = sent
    into.late[row] += verdict == LATE
    return verdict


@kernel
def _by_clock(
    row: Number, kind: Number, clock_ms: Number, time_s: float, goes_on: bool, follows: bool, into: Clocks
) -> tuple[int, bool]:
    """Judge a message with the autopilot's clock.

    Args:
        row: as of `judged`, and so are the next three.
        kind: a clocked one.
        clock_ms: at least 0.
        time_s: of arrival.
        goes_on: the number of its frame may be the next one.
        follows: it is, and not the same again.
        into: written.

    Returns: as `judged`, and whether the number of its frame is the newest.
    """
    known_ms, passed_s = into.clock_ms[row], time_s - into.clock_at_s[row]
    if known_ms < 0:
        known_ms = clock_ms
        passed_s = 0.0
    off_ms = _difference_ms(clock_ms, known_ms)
    sent_ms = known_ms + off_ms
    began_later = passed_s - 1e-3 * clock_ms >= -BEGUN_S
    if -LATE_MAX_MS <= off_ms <= 1e3 * passed_s + AHEAD_MAX_MS:
        if sent_ms >= into.newest[row, kind]:
            if kind == TIME and off_ms < -OVERTAKEN_MS:
                return LATE, goes_on
            into.newest[row, kind] = sent_ms
            if off_ms >= 0:
                into.clock_ms[row], into.clock_at_s[row] = sent_ms, time_s
                into.anew_count[row] = 0
            return GOOD, bool(goes_on or off_ms > 0)
        if not (follows or began_later):
            return LATE, False
    if not _agreed(row, clock_ms, time_s, into):
        return LATE, goes_on
    into.clock_ms[row], into.clock_at_s[row], into.anew_count[row] = clock_ms, time_s, 0
    into.newest[row, :CLOCKED] = -1
    into.newest[row, kind] = clock_ms
    into.least_base_s[row], into.rate_base_s[row] = np.nan, np.nan
    return RESTARTED if began_later else GOOD, True


@kernel
def _agreed(row: Number, clock_ms: Number, time_s: float, into: Clocks) -> bool:
    """Take a message of another clock. Returns: whether enough of them agree."""
    off_ms = _difference_ms(clock_ms, into.anew_ms[row])
    has_begun, passed_s = into.anew_count[row] > 0, time_s - into.anew_at_s[row]
    if has_begun and -LATE_MAX_MS <= off_ms < 0:
        return False
    if has_begun and abs(off_ms - 1e3 * passed_s) <= AGREES_MS:
        into.anew_count[row] += 1
    else:
        into.anew_count[row], into.anew_since_s[row] = 1, time_s
    into.anew_ms[row], into.anew_at_s[row] = clock_ms, time_s
    return bool(into.anew_count[row] >= AGREED and time_s - into.anew_since_s[row] >= AGREED_S)


@kernel
def _difference_ms(one_ms: Number, other_ms: Number) -> np.int64:
    """By how much one clock is ahead of the other, where both count in 32 bits."""
    half = np.int64(1) << (_CLOCK_BITS - 1)
    return ((one_ms - other_ms + half) & ((np.int64(1) << _CLOCK_BITS) - 1)) - half


@kernel
def note_answer(row: Number, asked_ns: Number, time_s: float, into: Clocks) -> None:
    """Take what a vehicle answered at `time_s`. What answers none of our requests counts for nothing.

    Args:
        row: the vehicle.
        asked_ns: our time in the request.
        time_s: of arrival.
        into: written.
    """
    for at in range(REQUESTS):
        if asked_ns != 0 and into.asked_ns[row, at] == asked_ns:
            into.asked_ns[row, : at + 1] = 0  # an answer to one before was lost
            trip_s = max(time_s - 1e-9 * asked_ns, 0.0)
            into.round_trip_s[row] = trip_s
            into.least_trip_s[row] = min(into.least_trip_s[row], trip_s)
            newest_s = into.newest_base_s[row]
            if trip_s - into.least_trip_s[row] <= PROMPT_S and time_s - newest_s[1] <= BESIDE_S:
                _measure_clock(row, newest_s[0], newest_s[1], into)
            return


@kernel
def _measure_clock(row: Number, base_s: float, time_s: float, into: Clocks) -> None:
    """Take a prompt position, which arrived at `time_s`: its vehicle's clock was 0 at `base_s` by ours."""
    least_s, from_s = into.least_base_s[row], into.rate_base_s[row]
    least_s[0], least_s[1] = base_s, time_s
    since_s = time_s - from_s[1]
    if since_s >= RATE_AFTER_S:
        into.rate[row] = min(max((base_s - from_s[0]) / since_s, -RATE_MAX), RATE_MAX)
    if not since_s < RATE_ANEW_S:
        from_s[0], from_s[1] = base_s, time_s


@kernel
def _due_s(row: Number, time_s: float, clocks: Clocks) -> float:
    """How long the second of the requests that have no answer waits for it; a single one may be lost."""
    waiting = 0
    for at in range(REQUESTS):
        waiting += clocks.asked_ns[row, at] != 0
        if waiting == 2:
            return float(time_s - 1e-9 * clocks.asked_ns[row, at])
    return 0.0


@kernel
def _late_by_clock_s(row: Number, base_s: float, time_s: float, into: Clocks) -> float:
    """How late a position is that arrived at `time_s`, by its vehicle's clock, which was 0 at `base_s`."""
    least_s = into.least_base_s[row]
    expected_s = least_s[0] + into.rate[row] * (time_s - least_s[1])
    is_set = not abs(base_s - expected_s) <= 1e-3 * LATE_MAX_MS  # also the first
    if is_set:
        into.rate[row], into.rate_base_s[row] = 0.0, np.nan
    if is_set or base_s < expected_s:
        least_s[0], least_s[1] = base_s, time_s
        return 0.0
    return float(base_s - expected_s)


@kernel
def note_position(row: Number, time_s: float, into: Clocks) -> None:
    """Find how late the position is that has just arrived, and was judged as good.

    Args:
        row: the vehicle.
        time_s: of arrival.
        into: written.
    """
    sent_ms = into.newest[row, POSITION]
    base_s = time_s - 1e-3 * sent_ms
    late_s = _late_by_clock_s(row, base_s, time_s, into)
    into.newest_base_s[row, 0], into.newest_base_s[row, 1] = base_s, time_s
    least_s, passed_s = into.least_late_s[row], time_s - into.window_s[row]
    if passed_s > LEAST_OF_S:
        for of in range(len(least_s)):
            least_s[of, 1] = least_s[of, 0] if passed_s <= 2.0 * LEAST_OF_S else np.inf
            least_s[of, 0] = np.inf
        into.window_s[row] = time_s
    least_s[0, 0] = min(least_s[0, 0], late_s)
    least_s[1, 0] = min(least_s[1, 0], 1e-3 * (into.clock_ms[row] - sent_ms))
    by_clock_s, behind_s = min(least_s[0, 0], least_s[0, 1]), min(least_s[1, 0], least_s[1, 1])
    answered_s = max(_due_s(row, time_s, into), into.round_trip_s[row]) - into.least_trip_s[row]
    if not answered_s > 0.0:  # NaN, -inf: none came
        answered_s = 0.0
    into.clock_late_s[row] = by_clock_s
    into.late_s[row] = max(min(by_clock_s, answered_s), behind_s)
