"""A target that reports where it is in a flight in virtual time, and how the formation follows it."""

from collections.abc import Callable

import numpy as np

from gcs.model.state import Array
from gcs.model.target_fix import TargetFix
from gcs.service.alarms import AlarmCause
from gcs.service.features import TargetView
from gcs.testing.virtual_show import VirtualShow

SPEED_M_S, PERIOD_S = 3.0, 0.2


def boat(show: VirtualShow) -> TargetView:
    targets = show.view.features.targets
    assert targets is not None
    return targets.targets[0]


def along_m(seconds: float) -> Array:
    """(3,) straight on, to the north-east of the show's origin."""
    return np.array([SPEED_M_S * seconds, 5.0, 0.0])


async def report(
    show: VirtualShow, seconds: float, place: Callable[[float], Array] = along_m, *, begin_s: float = 0.0
) -> None:
    """Report the boat five times a second for so long; `place` gets the seconds since `begin_s`."""
    for number in range(round(seconds / PERIOD_S)):
        place_m = place(begin_s + number * PERIOD_S)
        latitude_deg, longitude_deg, _ = show.config.frame.geodetic(place_m[None])
        fix = TargetFix(show.now_s, float(latitude_deg[0]), float(longitude_deg[0]))
        show.service.plan.report_target("boat", fix)
        await show.wait(PERIOD_S)


def off_m(show: VirtualShow, place_m: Array) -> float:
    return float(np.hypot(*(show.true_m.mean(axis=0) - place_m)[:2]))


def alarms(show: VirtualShow) -> set[AlarmCause]:
    return {alarm.cause for alarm in show.view.alarms if alarm.lasts}
