"""A followed target leaves the site, cuts its inner corner, and returns: the formation waits at the wall."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Orbit
from gcs.model.preflight_report import State
from gcs.model.state import Array
from gcs.safety.fenced_areas import FencedArea
from gcs.service import ShowAction
from gcs.service.alarms import AlarmCause
from gcs.simulation.site_figures import is_out
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from tests.support.reported_target import alarms, off_m, report
from tests.support.show_phases import running
from tests.support.written_show import TEXT, select
from tests.support.written_show import fly as fly_on_pads

pytestmark = pytest.mark.soak

Place = tuple[float, float]
ELL: Final = ((-40.0, -40.0), (90.0, -40.0), (90.0, 25.0), (25.0, 25.0), (25.0, 90.0), (-40.0, 90.0))
AREA: Final = FencedArea(corners_m=ELL)
AUDIENCE: Final = FencedArea(
    corners_m=((50.0, -15.0), (80.0, -15.0), (80.0, 25.0), (50.0, 25.0)), inside=False
)
TARGETS: Final[dict[str, Any]] = {
    "targets": [{"name": "boat", "sources": [{"kind": "rest"}], "deviation_m": 0.5, "coast_s": 3.0}]
}
SPEED_M_S: Final = 3.0
NOISE_M: Final = 0.4
"""Of the reports, along each axis: their receiver is as good as its deviation says."""

FOLLOWED_M: Final = 2.0
WHOLE_M: Final = 2.0
"""So far from its plan the sphere's height and width are at the wall: it is whole, not flat upon it."""


def config_with(*areas: FencedArea) -> Config:
    fence = {"areas": [area.model_dump() for area in areas]}
    return show_config(6, control={"safety": {"fence": fence}}, **TARGETS)


def between(begin_m: Place, end_m: Place, stays_s: float) -> tuple[Callable[[float], Array], float]:
    """A way with a stay at its end, as a receiver reports it; and how long it takes."""
    way_s = float(np.hypot(*np.subtract(end_m, begin_m))) / SPEED_M_S
    random = np.random.default_rng(7)

    def place(seconds: float) -> Array:
        share = min(seconds / max(way_s, 1e-3), 1.0)
        level_m = np.array(begin_m) + share * np.subtract(end_m, begin_m) + random.normal(0.0, NOISE_M, 2)
        return np.append(level_m, 0.0)

    return place, way_s + stays_s


def kept(show: VirtualShow, *areas: FencedArea) -> None:
    """No true position was ever on the wrong side of an area, and no pair too close."""
    flown_m = show.track.true_m.reshape(-1, 3)
    assert sum(int(is_out(area, flown_m).sum()) for area in areas) == 0
    assert show.floor_violations() == 0


def width_m(show: VirtualShow) -> Array:
    """(3,) of the formation, along each axis."""
    return np.asarray(np.ptp(show.true_m, axis=0))


async def follow(show: VirtualShow, orbit_m: float = 0.0) -> None:
    show.service.plan.set_orbit(Orbit(orbit_m, 4.0))
    show.service.plan.select_target("boat")


async def out_and_back(show: VirtualShow) -> tuple[Array, Array, float]:
    """Out over an edge, 50 m beyond it, and home. Returns: widths inside and at the wall, and how far off."""
    await follow(show)
    place, leaves_s = between((20.0, 0.0), (60.0, 0.0), stays_s=10.0)
    await report(show, leaves_s, place)
    inside_m = width_m(show)
    assert AlarmCause.TARGET_BEYOND not in alarms(show)
    place, gone_s = between((60.0, 0.0), (140.0, 0.0), stays_s=20.0)
    await report(show, gone_s, place)
    assert AlarmCause.TARGET_BEYOND in alarms(show)
    (text,) = (each.text for each in show.view.alarms if each.cause is AlarmCause.TARGET_BEYOND)
    assert "area 1 of the fence, which vehicles stay inside of" in text
    at_wall_m = width_m(show)
    place, back_s = between((140.0, 0.0), (20.0, 0.0), stays_s=10.0)
    await report(show, back_s, place)
    assert AlarmCause.TARGET_BEYOND not in alarms(show)
    kept(show, AREA)
    return inside_m, at_wall_m, off_m(show, np.array([20.0, 0.0, 0.0]))


def test_formation_waits_at_the_wall_and_follows_again() -> None:
    inside_m, at_wall_m, off = fly(out_and_back, config_with(AREA), after=running)
    assert off < FOLLOWED_M
    assert np.abs(at_wall_m - inside_m).max() < WHOLE_M


async def across_the_corner(show: VirtualShow) -> list[float]:
    await follow(show)
    ends_m, off = ((75.0, -5.0), (-5.0, 75.0), (75.0, -5.0)), []
    for begin_m, end_m in zip(((20.0, 0.0), *ends_m), ends_m, strict=False):
        place, seconds = between(begin_m, end_m, stays_s=25.0)
        await report(show, seconds, place)
        off.append(off_m(show, np.array([*end_m, 0.0])))
    kept(show, AREA)
    return off


@pytest.mark.soak
def test_target_that_cuts_a_concave_corner_is_met_behind_it() -> None:
    assert max(fly(across_the_corner, config_with(AREA), after=running)) < FOLLOWED_M


async def round_the_corner(show: VirtualShow) -> bool:
    """On an orbit of 20 m about a target that stands near the corner, goes round it, and cuts it."""
    await follow(show, 20.0)
    for begin_m, end_m in (
        ((20.0, 0.0), (10.0, 10.0)),
        ((10.0, 10.0), (70.0, 0.0)),
        ((70.0, 0.0), (0.0, 70.0)),
        ((0.0, 70.0), (10.0, 10.0)),
    ):
        place, seconds = between(begin_m, end_m, stays_s=25.0)
        await report(show, seconds, place)
    alarmed = AlarmCause.TARGET_BEYOND in alarms(show)
    kept(show, AREA)
    return alarmed


@pytest.mark.soak
def test_orbits_near_a_concave_corner_stay_inside() -> None:
    """The orbit has no room there: that is an alarm; where walls are, vehicles fly along them."""
    assert fly(round_the_corner, config_with(AREA), after=running)


async def into_the_audience(show: VirtualShow) -> float:
    await follow(show)
    place, seconds = between((20.0, 0.0), (65.0, 5.0), stays_s=20.0)
    await report(show, seconds, place)
    assert AlarmCause.TARGET_BEYOND in alarms(show)
    place, seconds = between((65.0, 5.0), (20.0, -10.0), stays_s=10.0)
    await report(show, seconds, place)
    kept(show, AREA, AUDIENCE)
    return off_m(show, np.array([20.0, -10.0, 0.0]))


@pytest.mark.soak
def test_target_that_walks_into_closed_space_is_met_after() -> None:
    assert fly(into_the_audience, config_with(AREA, AUDIENCE), after=running) < FOLLOWED_M


@pytest.mark.soak
def test_start_is_refused_while_the_target_is_outside() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        show.service.plan.select_target("boat")
        for place_m, state in (((60.0, 60.0), State.FAIL), ((0.0, 0.0), State.PASS)):
            await report(show, 2.0, lambda _, place_m=place_m: np.array([*place_m, 0.0]))  # type: ignore[misc]
            show.service.plan.select_target("boat")
            await report(show, 2.0, lambda _, place_m=place_m: np.array([*place_m, 0.0]))  # type: ignore[misc]
            check = {each.name: each for each in show.service.preflight.report().fleet}["target-followed"]
            assert check.state is state
        assert not check.problem

    fly(story, config_with(AREA))


@pytest.mark.soak
def test_show_with_a_guest_near_a_concave_corner(tmp_path: Path) -> None:
    """The guest leaves the site at its inner corner during the cue that follows the live target."""
    text = TEXT.replace("duration_s: 42.0", "duration_s: 110.0").replace("at_s: 34", "at_s: 100")
    fence = {"areas": [{"corners_m": [(-30, -30), (60, -30), (60, 14), (14, 14), (14, 60), (-30, 60)]}]}
    area = FencedArea.model_validate(fence["areas"][0])
    config = show_config(4, shows={"folder": tmp_path}, control={"safety": {"fence": fence}}, **TARGETS)

    async def story(show: VirtualShow) -> tuple[float, bool]:
        await show.standby()
        show.service.plan.select_target("boat")
        show_hash = select(show, text)
        await report(show, 2.0, lambda _: np.array([3.0, 1.0, 0.0]))
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        while show.view.show is not ShowPhase.RUNNING:
            await report(show, 1.0, lambda _: np.array([3.0, 1.0, 0.0]))
        place, seconds = between((3.0, 1.0), (3.0, 1.0), stays_s=24.0)
        await report(show, seconds, place)
        place, seconds = between((3.0, 1.0), (30.0, 30.0), stays_s=5.0)
        await report(show, seconds, place)
        alarmed = AlarmCause.TARGET_BEYOND in alarms(show)
        place, seconds = between((30.0, 30.0), (0.0, 0.0), stays_s=10.0)
        await report(show, seconds, place)
        kept(show, area)
        return off_m(show, np.zeros(3)), alarmed

    off, alarmed = fly_on_pads(story, config)
    assert alarmed
    assert off < FOLLOWED_M
