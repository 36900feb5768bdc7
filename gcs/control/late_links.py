"""Control over late links: the safety filter is given the delay, the fast inner loop is off. Pure.

The inner loop on the measured velocity (decision 0004) oscillates when its own effect is measured half a
second late; the separation filter keeps the floor if it knows the delay. Decision 0024.
"""

from typing import Final

import numpy as np

from gcs.control import ControlSettings
from gcs.model.state import Array, Mask

LATE_S: Final = 0.15
"""Telemetry that arrives so much later than it could is late; the loop's gains stand about as much."""

STEP_S: Final = 0.1
"""The delay is reckoned with in steps, rounded up: settings do not change with every sample."""

MOST_S: Final = 0.6
"""The greatest delay given to the filter: beyond it no velocity would satisfy its bounds."""

SHARE: Final = 0.9
"""The delay of the fleet is one that this share of its links does not pass."""

TRIM_SHARE: Final = 0.2
"""Of the rate at which the trim learns."""


def fleet_delay_s(late_s: Array, flying: Mask) -> float:
    """One-way delay of the flying vehicles: 0 while links are on time, else in whole steps."""
    if not flying.any():
        return 0.0
    delay_s = float(np.quantile(late_s[flying], SHARE))
    if delay_s < LATE_S:
        return 0.0
    return min(MOST_S, STEP_S * float(np.ceil(delay_s / STEP_S)))


def for_late_links(control: ControlSettings, delay_s: float) -> ControlSettings:
    """What the tick is set to at this delay, of telemetry and of setpoints alike."""
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
