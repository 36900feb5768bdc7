"""Settings of a tick while links are late."""

from typing import Final

import numpy as np

from gcs.control.inputs import ControlSettings
from gcs.model.state import Array, Mask

LATE_S: Final = 0.15
"""Telemetry this much later than possible is late; the loop's gains tolerate about this delay."""


STEP_S: Final = 0.1
"""The delay is rounded up to steps of this length, so that settings do not change with every sample."""


MOST_S: Final = 0.6
"""Greatest delay given to the filter: beyond it no velocity would satisfy its bounds."""


SHARE: Final = 0.9
"""Quantile of the vehicles' delays that is taken as the fleet's delay."""


TRIM_SHARE: Final = 0.2
"""Factor on the trim's learning rate while links are late."""


def fleet_delay_s(late_s: Array, flying: Mask) -> float:
    """One-way delay of the flying vehicles: 0 while links are on time, else a multiple of `STEP_S`."""
    flying_s = late_s[flying]
    if not (flying_s >= LATE_S).any():  # as nearly always: the quantile takes longer
        return 0.0
    delay_s = float(np.quantile(flying_s, SHARE))
    if delay_s < LATE_S:
        return 0.0
    return min(MOST_S, STEP_S * float(np.ceil(delay_s / STEP_S)))


def for_late_links(control: ControlSettings, delay_s: float) -> ControlSettings:
    """Settings of the tick at this delay, which is assumed for telemetry and setpoints alike.

    The filter keeps the floor if it knows the delay. The inner loop on the measured velocity is off: it
    oscillates when its own effect is measured half a second late. Decisions 0004 and 0024.
    """
    if delay_s <= control.safety.link_delay_s:
        return control
    safety = control.safety.model_copy(update={"link_delay_s": delay_s})
    slower = {
        "safety": safety,
        "loop_gain": 0.0,
        "vertical_loop_gain": 0.0,
        "trim_rate_per_s": TRIM_SHARE * control.trim_rate_per_s,
        "vertical_trim_rate_per_s": TRIM_SHARE * control.vertical_trim_rate_per_s,
    }
    return control.model_copy(update=slower)
