"""Everybody comes home together: on ways found beforehand, soon, and never inside the floor."""

from typing import NamedTuple

import numpy as np
import pytest
from virtual_show import Show, Track, fly, show_config

from gcs.lifecycle import Phase, ShowPhase
from gcs.service import OrderRecord, Outcome, ShowAction, VehicleAction

COUNT = 12
STOPPING_S = 5.0
"""Before the ways are planned, everybody stands."""


class Return(NamedTuple):
    track: Track
    stop_s: float
    landed_s: float
    order: OrderRecord
    start_m: np.ndarray[tuple[int, ...], np.dtype[np.float64]]
    floor_violations: int


async def whole_return(show: Show) -> Return:
    start_m = show.true_m
    await show.start()
    await show.wait(4.0)
    stop_s = show.now_s
    record = show.service.command_show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED, 120.0)
    order = await show.settled(record)
    return Return(show.track, stop_s, show.now_s, order, start_m, show.floor_violations())


@pytest.fixture(scope="module")
def flight() -> Return:
    config = show_config(COUNT, formation={"radius_m": 9.0, "height_m": 20.0})
    return fly(whole_return, config, grid_columns=4)


def test_everybody_is_home_and_nobody_was_inside_the_floor(flight: Return) -> None:
    assert flight.order.outcome is Outcome.DONE
    off_m = np.linalg.norm((flight.track.moments[-1].true_m - flight.start_m)[:, :2], axis=1)
    assert off_m.max() < 1.5
    assert flight.floor_violations == 0


def test_it_takes_little_longer_than_the_longest_straight_line(flight: Return) -> None:
    begin_m = flight.track.between(flight.stop_s).moments[0].true_m
    way_m = flight.start_m - begin_m
    straight_s = max(np.hypot(*way_m[:, :2].T).max() / 4.0, way_m[:, 2].max() / 1.4)
    assert flight.landed_s - flight.stop_s < 1.5 * straight_s + 10.0 + STOPPING_S


def test_they_stand_before_they_set_out(flight: Return) -> None:
    stopping = flight.track.between(flight.stop_s)
    first = next(m for m in stopping.moments if m.view.vehicles[0].reason == "on its way home")
    assert {seen.phase for seen in first.view.vehicles} == {Phase.RETURN}
    speeds_m_s = [np.linalg.norm(seen.velocity_m_s) for seen in first.view.vehicles if seen.velocity_m_s]
    assert max(speeds_m_s) < 0.5


def test_who_holds_and_who_is_stopped_on_the_way_are_part_of_it_or_left_out() -> None:
    async def story(show: Show) -> None:
        await show.start()
        await show.order("d1", VehicleAction.HOLD)
        record = show.service.command_show(ShowAction.STOP)
        await show.until(lambda: show.vehicle("d2").reason == "on its way home")
        assert show.vehicle("d1").reason == "on its way home"
        await show.order("d2", VehicleAction.HOLD)
        again = show.service.command_show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED, 120.0)
        assert show.service.order(record.id).outcomes["d2"].outcome is Outcome.FAILED
        assert {part.outcome for part in (await show.settled(again)).outcomes.values()} == {Outcome.DONE}
        assert show.floor_violations() == 0

    fly(story)
