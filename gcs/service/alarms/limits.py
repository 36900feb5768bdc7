"""Limits with hysteresis: a value beyond the limit counts as beyond until it is clearly back."""

from dataclasses import dataclass

import numpy as np

from gcs.model.state import Array, Mask


@dataclass(frozen=True, slots=True)
class Limit:
    """Two thresholds. With `off` above `on` low values are bad, otherwise high values."""

    on: float
    off: float

    @property
    def low_is_bad(self) -> bool:
        """Whether values below the limit are beyond it."""
        return self.off > self.on


def beyond(before: Mask, values: Array, limit: Limit) -> Mask:
    """(n,) Which values are beyond the limit; those between the thresholds keep their state `before`.

    An unknown value (NaN) is not beyond.
    """
    if limit.low_is_bad:
        return np.asarray((values < limit.on) | (before & (values < limit.off)))
    return np.asarray((values > limit.on) | (before & (values > limit.off)))
