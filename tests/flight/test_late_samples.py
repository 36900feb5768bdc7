"""Datagrams that arrive late, twice and in another order: each vehicle stays in the formation."""

from typing import NamedTuple

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, alarm_texts, fly, show_config
from tests.support.show_phases import running

pytestmark = pytest.mark.soak

LATE_SHARE, LATE_S = 0.1, (0.1, 10.0)


class Reported(NamedTuple):
    phases: dict[str, list[Phase]]
    show: list[ShowPhase]
    texts: set[str]
    off_m: float  # the farthest that an estimate was from the truth
    late_samples: int
    violations: int


async def flown_late(show: VirtualShow, seconds: float) -> Reported:
    """Fly for so long while a tenth of all datagrams is late, and half of them arrive twice."""
    for name in show.config.ids:
        show.befall(name, "duplicate", share=0.5, way="out")
        show.befall(name, "reorder", share=0.1, way="out")
        show.befall(name, "late", share=LATE_SHARE, least_s=LATE_S[0], most_s=LATE_S[1], way="out")
    began_s, texts = show.now_s, set[str]()
    while show.now_s < began_s + seconds:
        await show.wait(1.0)
        texts.update(alarm_texts(show))
    track = show.track.between(began_s + 1.0)
    off_m = max(
        float(np.linalg.norm(sample.view.rows.position_m - sample.true_m, axis=1).max())
        for sample in track.samples
    )
    return Reported(
        {name: track.phases(name) for name in show.config.ids},
        track.show_phases(),
        texts,
        off_m,
        show.link.counters.late_samples,
        show.floor_violations(track),
    )


def config(count: int) -> Config:
    return show_config(
        count,
        formation={"radius_m": 3.5 * count**0.5, "height_m": 8.0 + 4.0 * count**0.5},
        orbit={"radius_m": 10.0, "speed_m_s": 2.5},
        operation=HOLDS_WHEN_LOST,
    )


@pytest.mark.parametrize(("count", "seconds"), [(6, 30.0), pytest.param(20, 600.0, marks=pytest.mark.soak)])
def test_late_datagrams_take_no_vehicle_out(count: int, seconds: float) -> None:
    flown = fly(lambda show: flown_late(show, seconds), config(count), after=running)
    assert set(map(tuple, flown.phases.values())) == {(Phase.FORMATION,)}
    assert flown.show == [ShowPhase.RUNNING]
    assert flown.texts == set()
    assert flown.off_m < 2.0
    assert flown.late_samples > count * seconds / 4
    assert flown.violations == 0
