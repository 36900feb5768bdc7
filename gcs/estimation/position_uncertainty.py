"""Uncertainty of each vehicle's reported position, from its receiver's accuracy and after a jump. Pure."""

import numpy as np

from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import Array


class Positioning(Settings):
    """How reported accuracy and position resets widen a vehicle's margin (decision 0010).

    The floor's own uncertainty goes with the accuracy that a good receiver reports: as recorded, 0.9 m
    sideways and 1.8 m up, for an estimate that is 0.2 m off. Reported accuracy beyond that counts by `share`.
    """

    usual_horizontal_m: Positive = 1.0
    usual_vertical_m: Positive = 2.0
    share: NotNegative = 0.4  # recorded: 0.35 m of uncertainty at 0.9 m of accuracy
    uncertainty_max_m: Positive = 1.5  # if wider, the vehicles of a fleet could only flee from each other
    reset_margin_m: NotNegative = 0.7  # added after a position jumped
    reset_margin_s: NotNegative = 30.0
    freeze_s: NotNegative = 3.0  # a vehicle whose position jumped first stands still for this time


def excess_m(horizontal_m: Array, vertical_m: Array, positioning: Positioning) -> Array:
    """(n,) by how much reported accuracies (n,) are worse than usual, sideways or half of it upwards.

    0 where nothing is reported (NaN), inf without a fix.
    """
    sideways_m = horizontal_m - positioning.usual_horizontal_m
    up_m = (vertical_m - positioning.usual_vertical_m) / 2.0  # half, since the floor counts it twice there
    worse_m: Array = np.fmax(np.fmax(sideways_m, up_m), 0.0)
    return worse_m


def uncertainty_m(
    configured_m: float,
    horizontal_m: Array,
    vertical_m: Array,
    since_reset_s: Array,
    positioning: Positioning,
) -> Array:
    """Uncertainty of each position.

    Args:
        configured_m: least uncertainty.
        horizontal_m: (n,) accuracy as reported, one sigma; NaN unknown, inf without a fix.
        vertical_m: (n,) the same up and down.
        since_reset_s: (n,) since its position jumped, inf where it never did.
        positioning: settings.

    Returns: (n,) sideways, at most `uncertainty_max_m` (or the configured one, where that is more).
    """
    wider_m = positioning.share * excess_m(horizontal_m, vertical_m, positioning)
    wider_m += np.where(since_reset_s < positioning.reset_margin_s, positioning.reset_margin_m, 0.0)
    wide_m: Array = np.minimum(configured_m + wider_m, max(configured_m, positioning.uncertainty_max_m))
    return wide_m
