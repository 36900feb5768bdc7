"""Corrections of RTCM as GPS_RTCM_DATA: whole messages cut into fragments. No I/O.

Source: https://mavlink.io/en/messages/common.html#GPS_RTCM_DATA. Bit 0 of the flags says that it is cut,
bits 1 and 2 number its fragments, bits 3 to 7 number the messages. A receiver knows one as whole when it has
all four fragments, or all before the first one that is not full.
"""

from typing import Final

import numpy as np

from gcs.mavlink.codec import Records, records

GPS_RTCM_DATA: Final = 233
FRAGMENT_BYTES: Final = 180
FRAGMENTS_MAX: Final = 4
LONGEST_BYTES: Final = FRAGMENT_BYTES * FRAGMENTS_MAX
"""RTCM allows 1029 bytes. What is longer than this cannot be sent as one message."""

SEQUENCES: Final = 32


def fragments(message: bytes, sequence: int) -> Records:
    """GPS_RTCM_DATA of one RTCM message, in the order in which they are to leave.

    Args:
        message: 1 to `LONGEST_BYTES` bytes.
        sequence: number of the message; counts modulo `SEQUENCES`.

    Raises: ValueError for a message of another length.
    """
    if not 1 <= len(message) <= LONGEST_BYTES:
        raise ValueError(f"an RTCM message of {len(message)} bytes: 1 to {LONGEST_BYTES}")
    fragmented = len(message) > FRAGMENT_BYTES
    count = min(len(message) // FRAGMENT_BYTES + 1, FRAGMENTS_MAX) if fragmented else 1
    made = records(GPS_RTCM_DATA, count)
    for at in range(count):
        part = np.frombuffer(message[at * FRAGMENT_BYTES : (at + 1) * FRAGMENT_BYTES], np.uint8)
        made["flags"][at] = int(fragmented) | at << 1 | sequence % SEQUENCES << 3
        made["len"][at] = len(part)
        made["data"][at, : len(part)] = part
    return made
