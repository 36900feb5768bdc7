"""Stalls the station of a virtual show as SIGSTOP does: the station pauses while the vehicles fly on."""

import asyncio
from typing import Any

import numpy as np

from gcs.model.state import Array
from gcs.safety.floor import minimum_separation
from gcs.testing.virtual_show import VirtualShow

RECEIVED_FIRST: float = 1.0
"""Share of the messages sent meanwhile that is received afterwards: buffers overflow and keep the oldest."""


def stall(show: VirtualShow, seconds: float, *, kept_share: float = RECEIVED_FIRST) -> Array:
    """Let time pass for the vehicles only; the station receives their messages when it continues.

    Args:
        show: running.
        seconds: how long.
        kept_share: share of their messages that is kept, the oldest.

    Returns: (k, n, 3) true positions during the stall, show frame.
    """
    loop: Any = asyncio.get_running_loop()  # async_solipsism's
    end_s = loop.time() + seconds
    true_m = []
    while show.fleet.time_s + show.fleet.step_s / 2 < end_s:
        show.ports.step()
        true_m.append(show.true_m)
    show.ports.keep_oldest(kept_share)
    loop._selector.clock.advance(end_s - loop.time())
    return np.array(true_m)


def floor_violations(show: VirtualShow, true_m: Array) -> int:
    """Number of steps at which the true positions of a pair were inside the floor."""
    floor, all_vehicles = show.config.control.safety.floor, np.ones(len(show.config.ids), dtype=np.bool_)
    return sum(minimum_separation(here_m, all_vehicles, floor)[1] > 0 for here_m in true_m)
