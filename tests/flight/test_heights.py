"""ArduCopters with the recorded scale of heights fly beside PX4: they are named, and the floor holds."""

from typing import NamedTuple

import numpy as np
import pytest

from gcs.model.state import Array
from gcs.service.alarms import AlarmCause
from gcs.testing.virtual_show import VirtualShow, fly
from tests.flight.test_mixed_stalls import config

HEIGHT_M = 25.0
NAMED_WITHIN_S = 30.0
STANDS_S = 60.0
"""Before the start: all of the reference. After 25 s the noise of the three PX4s hides half of the scale."""

ARDUPILOT = ("d2", "d4", "d6")


class Outcome(NamedTuple):
    texts: list[str]  # of each vehicle that is named
    wider_m: Array  # (n,) more uncertainty than at the start
    off_m: float  # by how much the ArduCopters truly fly below what they report
    violations: int
    drifted: list[str]  # checks that fail before the start


@pytest.mark.soak
def test_scale_of_heights_is_named_and_floor_holds() -> None:
    async def story(show: VirtualShow) -> Outcome:
        await show.standby()
        await show.wait(STANDS_S)
        checks = show.service.preflight.report().vehicles
        drifted = [
            one.id for one in checks for check in one.checks if "drift" in check.name and not check.passes
        ]
        before_m = show.view.rows.uncertainty_m
        await show.start()

        def named() -> set[str]:
            alarms = [one for one in show.view.alarms if one.cause is AlarmCause.HEIGHT_DIFFERS]
            return {name for one in alarms for name in one.vehicles}

        await show.until(lambda: named() == set(ARDUPILOT), NAMED_WITHIN_S)
        await show.wait(1.0)
        (alarm,) = [one for one in show.view.alarms if one.cause is AlarmCause.HEIGHT_DIFFERS]
        wider_m = show.view.rows.uncertainty_m - before_m
        reported_m = -show.view.rows.position_m[:, 2]
        off_m = float(np.mean((reported_m + show.true_m[:, 2])[1::2]))
        return Outcome(
            [each.because for each in alarm.reasons], wider_m, off_m, show.floor_violations(), drifted
        )

    flown = fly(story, config(HEIGHT_M), spacing_m=5.5)
    assert flown.drifted == []
    assert len(flown.texts) == len(ARDUPILOT)
    assert all("below what it reports, by its receiver and the others" in text for text in flown.texts)
    assert 0.8 < flown.off_m < 1.8
    assert (flown.wider_m[1::2] > 0.05).all()
    assert flown.wider_m[0::2].max() <= 0.2 + 1e-9, "by the reset of their estimators at the take-off only"
    assert flown.violations == 0
