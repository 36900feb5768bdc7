"""Whether all vehicles notice the loss of this station at one time, whatever their autopilots are. Pure.

Until each notices, it flies on with its last setpoint. A plan may change in flight, up to the fastest target
and the smallest sphere, so that no plan allows for vehicles that stop while others fly on.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from gcs.model.errors import RefusedError
from gcs.model.state import Array, VehicleId
from gcs.planning.setpoint_loss import NOTICED_WITHIN_S

APART_MAX_S: Final = NOTICED_WITHIN_S
"""Greatest difference of two loss times: each pair is given room for one that stops so much later."""

NAMED_MAX: Final = 8


def check_loss_times(ids: Sequence[VehicleId], flies_on_s: Array, elsewhere_s: float | None = None) -> None:
    """Check that vehicles fly on for the same time without setpoints.

    Args:
        ids: n vehicles that are to fly.
        flies_on_s: (n,) how long each flies on, by its parameters as read.
        elsewhere_s: what other stations demand of their vehicles; None: there are none.

    Raises: RefusedError naming the vehicles by their times.
    """
    if elsewhere_s is not None:
        ids, flies_on_s = [*ids, "other stations' vehicles"], np.append(flies_on_s, elsewhere_s)
    if not len(flies_on_s) or np.ptp(flies_on_s) <= APART_MAX_S:
        return
    longest_s = float(flies_on_s.max())
    groups = [
        f"{_named([ids[row] for row in np.flatnonzero(flies_on_s == time_s).tolist()])} for {time_s:g} s"
        for time_s in np.unique(flies_on_s)[::-1].tolist()
    ]
    raise RefusedError(
        f"without setpoints {', '.join(groups)} fly on before they stop, at most {APART_MAX_S:g} s apart are"
        " allowed: those that fly on would meet those that have stopped. Set operation.setpoint_loss_s to a"
        f" time that all can have ({longest_s:g} s is the longest now), stop the service, and run:"
        " gcs params apply --config FILE"
    )


def _named(names: Sequence[VehicleId]) -> str:
    more = len(names) - NAMED_MAX
    return ", ".join(names[:NAMED_MAX]) + (f" and {more} more" if more > 0 else "")
