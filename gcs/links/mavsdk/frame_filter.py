"""The frames that MAVSDK receives: each costs its threads more than it costs the link."""

from typing import Final

import numpy as np

from gcs.links.stream_rates import NOT_FOR_MAVSDK, REQUESTING_COMPONENT
from gcs.mavlink import codec
from gcs.mavlink.framing import COMMAND_ACK, GLOBAL_POSITION_INT
from gcs.mavlink.kernels import MESSAGE, Bytes, Whole
from gcs.model.state import Array, Mask

_POSITION_PERIOD_S: Final = 0.5
"""Period of the positions that MAVSDK receives; the tick uses all of them."""


class FrameFilter:
    """Chooses the frames for MAVSDK. Rows as on the link."""

    def __init__(self, count: int) -> None:
        self._hidden: Whole = np.array(sorted(NOT_FOR_MAVSDK), np.int64)
        self._position_s = np.full(count, -np.inf)  # arrival of the newest position given to MAVSDK

    def of(self, data: Bytes, frames: Whole, rows: Whole, time_s: Array) -> Mask:
        """(k,) which frames MAVSDK receives; arguments as of `FleetTelemetry.take`."""
        message = frames[:, MESSAGE]
        shown: Mask = ~np.isin(message, self._hidden)
        positions = np.flatnonzero(message == GLOBAL_POSITION_INT)
        due = time_s[positions] - self._position_s[rows[positions]] >= _POSITION_PERIOD_S
        shown[positions] = due
        self._position_s[rows[positions[due]]] = time_s[positions[due]]
        answers = np.flatnonzero(message == COMMAND_ACK)
        if len(answers):  # MAVSDK did not send these requests
            stated = codec.decode(COMMAND_ACK, data, frames[answers])
            shown[answers] = stated["target_component"] != REQUESTING_COMPONENT
        return shown
