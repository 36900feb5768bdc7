"""A written show, flown by the service: the clock leads, pauses cost nothing, and it ends at home."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from gcs.model.errors import RefusedError
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Formation, Obstacle, Orbit, Target
from gcs.recording.audit_reader import last_known
from gcs.recording.mcap_reader import FlightData
from gcs.recording.session import Record
from gcs.service import CommandRecord, Outcome, SelectedShow, ShowAction
from gcs.shows import Timeline, parse
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import JUMP_M_S, FlownTrack, VirtualShow, refused
from tests.support.audit_rows import events
from tests.support.written_show import NAME, TEXT, config, fly, select

GUEST_M = (12.0, 4.0)
PAUSED_S = 32.0  # longer than the rest of the show
CRANE = Obstacle("crane", 60.0, -60.0, 2.0, 2.0, 20.0)


class Flight(NamedTuple):
    timeline: Timeline
    track: FlownTrack
    started: CommandRecord
    paused_s: tuple[float, float]
    refusals: dict[str, str]
    floor_violations: int


async def whole_show(show: VirtualShow) -> Flight:
    service = show.service
    show_hash = select(show)
    await show.standby()
    started = service.commands.command_show(ShowAction.START, show_hash=show_hash)
    await show.reach(ShowPhase.RUNNING)
    await show.until(lambda: selected(show).clock_s > 11.0)
    refusals = {
        "formation": await refused(show, lambda: service.plan.set_formation(Formation(8.0, 15.0))),
        "orbit": await refused(show, lambda: service.plan.set_orbit(Orbit(5.0))),
        "target": await refused(show, lambda: service.plan.set_target(Target(1.0, 1.0))),
        "own box": await refused(show, lambda: service.plan.add_obstacle(Obstacle("tower", 0, 0, 1, 1, 5))),
    }
    assert {each.kind for each in refusals.values()} == {RefusedError}
    service.plan.add_obstacle(CRANE)
    service.commands.command_show(ShowAction.PAUSE)
    pause_s = show.now_s
    await show.wait(PAUSED_S)
    service.commands.command_show(ShowAction.RESUME)
    resume_s = show.now_s
    await show.until(lambda: selected(show).cue == "guest", 90.0)
    service.plan.set_target(Target(*GUEST_M))
    await show.until(lambda: selected(show).cue == "tower")
    await show.reach(ShowPhase.LANDED, 120.0)
    await show.wait(0.1)  # the track has this tick, too
    return Flight(
        Timeline.of(parse(TEXT, NAME).show),
        show.track,
        service.command_log.get(started.id),
        (pause_s, resume_s),
        {what: refusal.text for what, refusal in refusals.items()},
        show.floor_violations(),
    )


def selected(show: VirtualShow) -> SelectedShow:
    found = show.view.selected
    assert found is not None
    return found


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the flight is recorded."""
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory, runs: Path) -> Flight:
    asked = config(tmp_path_factory.mktemp("shows"))
    vehicles = {name: (row + 1, "loop") for row, name in enumerate(asked.ids)}
    with Record(runs, asked.model_dump_json(), vehicles) as record:
        return fly(whole_show, asked, record=record)


def running(flight: Flight) -> FlownTrack:
    samples = tuple(sample for sample in flight.track.samples if sample.view.show is ShowPhase.RUNNING)
    return FlownTrack(samples, flight.track.ids)


def test_timeline_sets_formation_and_orbit_in_every_tick(flight: Flight) -> None:
    samples = running(flight).samples
    assert len(samples) > 700
    for sample in samples:
        assert sample.view.selected is not None
        desired = flight.timeline.plan_at(sample.view.selected.clock_s)
        assert sample.view.plan.formation == desired.formation
        assert sample.view.plan.orbit == desired.orbit
        assert sample.view.selected.cue == flight.timeline.cue_at(sample.view.selected.clock_s).cue.cue


def test_target_follows_the_show_until_live_then_the_reports(flight: Flight) -> None:
    for sample in running(flight).samples:
        assert sample.view.selected is not None
        now_s = sample.view.selected.clock_s
        if now_s < 26.0:
            assert sample.view.target_m == pytest.approx(
                flight.timeline.plan_at(now_s).target.position_m(now_s)
            )
    last = running(flight).samples[-1].view
    assert last.target_m == pytest.approx(GUEST_M)
    assert last.center_m is not None
    assert last.center_m[:2] == pytest.approx(GUEST_M, abs=1.0)


def test_formation_follows_the_path_of_the_show(flight: Flight) -> None:
    at_20 = next(m for m in running(flight).samples if m.view.selected and m.view.selected.clock_s > 17.5)
    assert at_20.true_m.mean(axis=0)[:2] == pytest.approx((11.0, 1.0), abs=1.0)


def test_true_formation_turns_as_the_show_says(flight: Flight) -> None:
    turning = [
        sample
        for sample in running(flight).samples
        if sample.view.selected is not None and 22.0 < sample.view.selected.clock_s < 25.0
    ]
    first, last = turning[0].true_m, turning[-1].true_m
    (ax, ay), (bx, by) = ((each - each.mean(axis=0))[:, :2].T for each in (first, last))
    turned_deg = np.degrees(np.arctan2((ax * by - ay * bx).sum(), (ax * bx + ay * by).sum()))
    assert turned_deg == pytest.approx(30.0, abs=8.0)


def test_the_lights_are_the_vehicles_in_turn(flight: Flight) -> None:
    samples = running(flight).samples
    assert [seen.colour for seen in vehicles_of(samples[0].view)] == ["#ff0000", "#0000ff"] * 2
    assert [seen.colour for seen in vehicles_of(samples[-1].view)] == ["#00ff00"] * 4


def test_pause_stops_show_clock_and_vehicles_setpoints_continue(flight: Flight) -> None:
    begin_s, end_s = flight.paused_s
    paused = flight.track.between(begin_s + 0.1, end_s)
    clocks = {sample.view.selected.clock_s for sample in paused.samples if sample.view.selected}
    assert len(clocks) == 1
    still = flight.track.between(begin_s + 10.0, end_s)
    drift_m = np.ptp(still.true_m, axis=0)
    assert np.hypot(drift_m[:, 0], drift_m[:, 1]).max() < 1.5  # the fake's own position error
    for name in flight.track.ids:
        assert paused.setpoints_per_s(name) == pytest.approx(20.0, rel=0.02)
    assert np.abs(np.nanmean(still.setpoint_m_s, axis=0)).max() < 0.1


def test_a_resume_goes_on_where_the_pause_began_without_a_jump(flight: Flight) -> None:
    pause_s, resume_s = flight.paused_s
    paused_at = next(m.view.selected for m in flight.track.between(pause_s + 1.0).samples)
    assert paused_at is not None
    clocks = [
        sample.view.selected.clock_s
        for sample in flight.track.between(resume_s).samples
        if sample.view.selected and sample.view.show is ShowPhase.RUNNING
    ]
    assert clocks[0] == pytest.approx(paused_at.clock_s, abs=0.051)
    assert np.diff(clocks).max() < 0.051
    assert flight.track.hardest_change_m_s() < JUMP_M_S


def test_the_show_comes_home_by_itself_when_it_is_over(flight: Flight) -> None:
    assert flight.track.show_phases() == [
        ShowPhase.IDLE,
        ShowPhase.ARMING,
        ShowPhase.ASSEMBLING,
        ShowPhase.RUNNING,
        ShowPhase.PAUSED,
        ShowPhase.RUNNING,  # the sphere still stands
        ShowPhase.RETURNING,
        ShowPhase.LANDED,
    ]
    returning = next(m for m in flight.track.samples if m.view.show is ShowPhase.RETURNING)
    assert "small" in returning.view.reason
    assert returning.view.selected is not None
    assert returning.view.selected.clock_s == pytest.approx(42.0, abs=0.1)
    assert flight.started.outcome is Outcome.DONE
    assert flight.track.samples[-1].armed == (False,) * 4


def test_true_separation_keeps_the_floor(flight: Flight) -> None:
    assert flight.floor_violations == 0


def test_plan_changes_against_the_show_are_refused_with_choices(flight: Flight) -> None:
    for text in flight.refusals.values():
        assert "paused or stopped" in text
    assert "'walk'" in flight.refusals["target"]


def test_obstacles_of_show_and_operator_are_combined(flight: Flight) -> None:
    assert {box.id for box in running(flight).samples[-1].view.plan.obstacles} == {"crane", "tower"}


def test_record_holds_the_show_and_the_times_of_its_cues(flight: Flight, runs: Path) -> None:
    reported = events(runs)
    cues = [event["detail"]["cue"] for event in reported if event["event"] == "cue"]
    assert cues == ["stand", "walk", "turn", "guest", "tower", "stand"]
    show_hash = flight.timeline.show.digest
    assert {event["detail"]["hash"] for event in reported if event["event"] == "cue"} == {show_hash}
    assert sum(event["event"] == "plan" for event in reported) < 12  # not one for every tick
    session = last_known(runs).session
    assert session is not None
    flown = list(FlightData(session.folder / "flight.mcap").ticks())
    assert {tick.status.selected.cue for tick in flown if tick.status.selected} == set(cues)
    clocks = [
        tick.status.selected.clock_s
        for tick in flown
        if tick.status.selected and tick.status.show == "running"
    ]
    assert np.diff(clocks).max() < 1.1  # s; told again that often


def test_afterwards_the_show_is_at_its_beginning_again(flight: Flight) -> None:
    last = flight.track.samples[-1].view.selected
    assert last is not None
    assert (last.clock_s, last.cue, last.runs) == (0.0, "stand", False)
