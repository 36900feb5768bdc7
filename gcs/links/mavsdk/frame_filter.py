"""What of the vehicles' frames MAVSDK is shown: every one costs its threads more than it costs us."""

from typing import Final

import numpy as np

from gcs.links.stream_rates import NOT_FOR_MAVSDK, REQUESTING_COMPONENT
from gcs.mavlink import codec
from gcs.mavlink.framing import COMMAND_ACK, GLOBAL_POSITION_INT
from gcs.mavlink.kernels import MESSAGE, Bytes, Whole
from gcs.model.state import Array, Mask

_POSITION_PERIOD_S: Final = 0.5
"""So often MAVSDK is shown a position; for the tick we read them all."""


class FrameFilter:
    """Chooses frames. Rows as on the link."""

    def __init__(self, count: int) -> None:
        self._hidden: Whole = np.array(sorted(NOT_FOR_MAVSDK), np.int64)
        self._position_s = np.full(count, -np.inf)  # arrival of the position that it was shown last

    def of(self, data: Bytes, frames: Whole, rows: Whole, time_s: Array) -> Mask:
        """(k,) which of them MAVSDK is to see; arguments as of `FleetTelemetry.take`."""
        message = frames[:, MESSAGE]
        shown: Mask = ~np.isin(message, self._hidden)
        positions = np.flatnonzero(message == GLOBAL_POSITION_INT)
        due = time_s[positions] - self._position_s[rows[positions]] >= _POSITION_PERIOD_S
        shown[positions] = due
        self._position_s[rows[positions[due]]] = time_s[positions[due]]
        answers = np.flatnonzero(message == COMMAND_ACK)
        if len(answers):  # it knows of no question
            stated = codec.decode(COMMAND_ACK, data, frames[answers])
            shown[answers] = stated["target_component"] != REQUESTING_COMPONENT
        return shown
