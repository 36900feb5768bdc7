"""What else of the received frames is read, beside telemetry: by the parts of a link, and by features."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from gcs.mavlink.kernels import COMPONENT, MESSAGE, Bytes, Whole
from gcs.model.state import Array

TakeFrames: TypeAlias = Callable[[Bytes, Whole, Whole, Array], None]
"""Called with a buffer, (k, FRAME_COLUMNS) frames in it, and (k,) rows and times of arrival; never fails."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameListener:
    """Accepted frames of some components and messages, in order of arrival."""

    components: range
    messages: tuple[int, ...]
    take: TakeFrames

    def offer(self, data: Bytes, frames: Whole, rows: Whole, time_s: Array) -> None:
        component, message = frames[:, COMPONENT], frames[:, MESSAGE]
        chosen = (component >= self.components.start) & (component < self.components.stop)
        chosen &= np.isin(message, self.messages)
        if chosen.any():
            self.take(data, frames[chosen], rows[chosen], time_s[chosen])
