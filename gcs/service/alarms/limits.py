"""Values at a limit: what has passed it counts as beyond until it is clearly back."""

from dataclasses import dataclass

import numpy as np

from gcs.model.state import Array, Mask


@dataclass(frozen=True, slots=True)
class Limit:
    """Two thresholds. With `off` above `on` low values are bad, else high ones."""

    on: float
    off: float

    @property
    def low_is_bad(self) -> bool:
        """Whether values below the limit are beyond it."""
        return self.off > self.on


def beyond(before: Mask, values: Array, limit: Limit) -> Mask:
    """(n,) which values are beyond the limit, given which were: those between the thresholds stay.

    A value that is not known (NaN) is not beyond.
    """
    if limit.low_is_bad:
        return np.asarray((values < limit.on) | (before & (values < limit.off)))
    return np.asarray((values > limit.on) | (before & (values > limit.off)))
