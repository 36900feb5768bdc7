"""What is known of the senders of frames, kept up to date in one compiled loop. No I/O."""

from typing import Final, NamedTuple

import numpy as np

from gcs.links.continuity import Continuity, boot_ms_of, note_frame, number_of
from gcs.mavlink.codec import AUTOPILOT_COMPONENT, offset
from gcs.mavlink.framing import HEARTBEAT, NO_AUTOPILOT, RADIO, RADIO_STATUS
from gcs.mavlink.kernels import (
    BEGIN,
    COMPONENT,
    DATAGRAM,
    FRAME_COLUMNS,
    LENGTH,
    MESSAGE,
    PAYLOAD,
    SYSTEM,
    Bytes,
    Whole,
)
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask

NOWHERE: Final = -1
"""The source of a vehicle without an address."""

_AUTOPILOT_AT: Final = offset(HEARTBEAT, "autopilot")
ANY, AUTOPILOTS = 0, 1
"""Columns of `Parts`."""


class Parts(NamedTuple):
    """Further components of n systems that were received, at whatever address; written in place.

    The first column is any of them, the second one with an autopilot's heartbeat.
    """

    component: Whole  # (n, 2) the newest
    time_s: Array  # (n, 2) its arrival, -inf before

    @staticmethod
    def unknown(n: int) -> "Parts":
        return Parts(np.zeros((n, 2), np.int64), np.full((n, 2), -np.inf))


class Senders(NamedTuple):
    """What is known of the senders of n systems; written in place."""

    received_s: Array  # (n,) arrival of the autopilot's newest frame
    confirmed: Mask  # (n,) an autopilot's heartbeat has come from the known source
    continuity: Continuity
    parts: Parts

    @staticmethod
    def unknown(n: int) -> "Senders":
        never_s = np.full(n, -np.inf)
        return Senders(never_s, np.zeros(n, np.bool_), Continuity.unknown(n), Parts.unknown(n))


@kernel
def known_sources(
    data: Bytes,
    frames: Whole,
    source: Whole,
    time_s: Array,
    row_of: Whole,
    source_of: Whole,
    senders: Senders,
) -> tuple[Whole, Mask, Whole, Array]:
    """Frames that came from the known sources of their systems.

    An autopilot is component 1. What has its number and is none is dropped: a radio's own message, or a
    heartbeat without an autopilot. Other components are accepted from their autopilot's source, and never
    change it.

    Args:
        data: buffer that contains the frames.
        frames: (k, FRAME_COLUMNS).
        source: (m,) of each datagram.
        time_s: (m,) of its arrival.
        row_of: (256,) the row of each system id, or NOWHERE.
        source_of: (n,) the source of each row, or NOWHERE.
        senders: of each row, written.

    Returns: (k,) the row of each; (k,) whether it is accepted; (j, 3) place, sequence number and boot clock
    of those still to be judged; (k,) times of arrival.
    """
    received_s, confirmed = senders.received_s, senders.confirmed
    continuity, parts = senders.continuity, senders.parts
    rows, arrived_s = np.empty(len(frames), np.int64), np.empty(len(frames))
    taken = np.empty(len(frames), np.bool_)
    odd, odd_count = np.empty((len(frames), 3), np.int64), 0
    for k in range(len(frames)):
        frame, datagram = frames[k], frames[k, DATAGRAM]
        row, message, now_s = row_of[frame[SYSTEM]], frame[MESSAGE], time_s[datagram]
        rows[k], arrived_s[k] = row, now_s
        taken[k] = row != NOWHERE and source_of[row] == source[datagram]
        is_beat, is_radio = False, message in (RADIO_STATUS, RADIO)
        if message == HEARTBEAT:
            at = frame[PAYLOAD] + _AUTOPILOT_AT
            is_beat = frame[LENGTH] <= _AUTOPILOT_AT or data[at] != NO_AUTOPILOT
        if row != NOWHERE and frame[COMPONENT] != AUTOPILOT_COMPONENT:
            for column in range(0 if is_radio else 1 + is_beat):
                parts.component[row, column] = frame[COMPONENT]
                parts.time_s[row, column] = now_s
        elif row != NOWHERE and (is_radio or (message == HEARTBEAT and not is_beat)):
            taken[k] = False
        else:
            number, boot_ms = number_of(data, frame[BEGIN]), boot_ms_of(data, frame)
            if taken[k]:
                received_s[row] = max(now_s, received_s[row])
                confirmed[row] |= is_beat
                note_frame(number, boot_ms, row, now_s, continuity)
            else:
                odd[odd_count, 0], odd[odd_count, 1], odd[odd_count, 2] = k, number, boot_ms
                odd_count += 1
    return rows, taken, odd[:odd_count], arrived_s


def warm_up() -> None:
    """Compile or load the kernel."""
    nothing, none, times_s = np.zeros((0, FRAME_COLUMNS), np.int64), np.zeros(0, np.int64), np.zeros(0)
    known_sources(np.zeros(1, np.uint8), nothing, none, times_s, none, none, Senders.unknown(0))
