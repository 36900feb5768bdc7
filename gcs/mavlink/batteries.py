"""The charge of vehicles with several battery packs, from their messages. Compiled."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import development as dialect

from gcs.mavlink.kernels import Number, Whole
from gcs.model.jit import kernel
from gcs.model.state import Array

PACKS: Final = 256
"""BATTERY_STATUS numbers them; the column after them is SYS_STATUS, of all together."""

NO_PERCENT: Final = 127
"""In int8, above every percentage, so that the minimum ignores it."""

FORGOTTEN_AFTER_S: Final = 10.0
"""A pack without a message for this time, while others are received, is forgotten on the ground."""

RECEIVED_MAX_S: Final = 2.0
"""A longer pause between two messages about batteries is one of the link, and says nothing about a pack."""

BESIDE_PROPULSION: Final = (
    int(dialect.MAV_BATTERY_FUNCTION_AVIONICS),
    int(dialect.MAV_BATTERY_FUNCTION_PAYLOAD),
)
"""Without these a vehicle flies on. Every other function, and an unknown one, may feed the motors."""


class Packs(NamedTuple):
    """Of n vehicles, written in place."""

    percent: NDArray[np.int8]  # (n, PACKS + 1)
    at_s: Array  # (n, PACKS + 1) `received_s` at the newest message of each
    time_s: Array  # (n,) arrival of the newest message about any
    received_s: Array  # (n,) time during which such messages were received
    remaining: Array  # (n,) 0 to 1 of the emptiest; NaN: not known
    forgotten: Whole  # (n,) a pack that was the emptiest, until it is reported; -1: none

    @staticmethod
    def unknown(n: int) -> "Packs":
        """Nothing received."""
        return Packs(
            percent=np.full((n, PACKS + 1), NO_PERCENT, np.int8),
            at_s=np.zeros((n, PACKS + 1)),
            time_s=np.full(n, -np.inf),
            received_s=np.zeros(n),
            remaining=np.full(n, np.nan),
            forgotten=np.full(n, -1, np.int64),
        )


@kernel
def note_percent(
    row: Number, pack: Number, percent: np.int64, time_s: float, armed: bool, into: Packs
) -> None:
    """The newest percentage of a pack; below 0: unknown. A vehicle is as empty as its emptiest pack."""
    passed_s = time_s - into.time_s[row]
    into.received_s[row] += min(max(passed_s, 0.0), RECEIVED_MAX_S)
    into.time_s[row], now_s = time_s, into.received_s[row]
    into.percent[row, pack] = min(percent, np.int64(100)) if percent >= 0 else NO_PERCENT
    into.at_s[row, pack] = now_s
    least, gone_least, gone = np.int64(NO_PERCENT), np.int64(NO_PERCENT), np.int64(-1)
    for slot in range(PACKS + 1):
        remaining = np.int64(into.percent[row, slot])
        if remaining == NO_PERCENT:
            continue
        if slot < PACKS and not armed and now_s - into.at_s[row, slot] > FORGOTTEN_AFTER_S:
            into.percent[row, slot] = NO_PERCENT
            if remaining < gone_least:
                gone_least, gone = remaining, np.int64(slot)
        else:
            least = min(least, remaining)
    if gone_least < least:
        into.forgotten[row] = gone
    into.remaining[row] = np.nan if least == NO_PERCENT else least / 100.0


@kernel
def forget_packs(row: Number, into: Packs) -> None:
    """Forget a vehicle's packs: its autopilot has started, and they may be others."""
    into.percent[row] = NO_PERCENT
    into.remaining[row] = np.nan
