"""Who may take off, who may not and why, and what happens when one of them does not get up."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from gcs.model.errors import GcsError, InvalidError, RefusedError, UnknownError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Formation, Obstacle
from gcs.model.state import Array, Mode
from gcs.planning.landing_sites import column_m, overlapping
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.sim.vehicle.px4 import Quirks
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import (
    TAKEOFF_HEIGHT_M,
    FlownTrack,
    RefusedCall,
    VirtualShow,
    alarm_texts,
    fly,
    refused,
    show_config,
)


def start_of(*names: str) -> Callable[[VirtualShow], Callable[[], CommandRecord]]:
    """A request to start with these vehicles, or with all."""
    return lambda show: lambda: show.service.commands.command_show(ShowAction.START, names or None)


async def too_early(show: VirtualShow) -> tuple[RefusedCall, RefusedCall, RefusedCall]:
    """Without a position; then with one, but still starting up; then with an old one."""
    await show.until(
        lambda: all(np.isfinite(seen.heartbeat_age_s or np.nan) for seen in vehicles_of(show.view))
    )
    no_position = await refused(show, start_of()(show))
    await show.until(lambda: all(seen.phase is Phase.STANDBY for seen in vehicles_of(show.view)))
    not_ready = await refused(show, start_of()(show))
    await show.standby()
    show.ports.silence("d2")
    await show.wait(0.8)
    return no_position, not_ready, await refused(show, start_of()(show))


def test_start_is_refused_without_position_or_failed_checks() -> None:
    no_position, not_ready, old_position = fly(too_early, show_config(2), quirks=Quirks())
    for refusal in (no_position, not_ready, old_position):
        assert refusal.kind is RefusedError
        assert refusal.plan_kept
    assert no_position.text.startswith("d1, d2: offline: received, but it has no position yet; ")
    assert "does not yet pass its own arming checks" in not_ready.text
    assert old_position.text.startswith("d2: no position for ")
    assert "d1" not in old_position.text


async def several_faults(show: VirtualShow) -> RefusedCall:
    await show.standby()
    show.befall("d1", "battery", remaining=0.2)
    show.ports.duplicated.add("d2")
    await show.wait(2.5)
    return await refused(show, start_of()(show))


def test_start_is_refused_naming_each_vehicle_and_its_fault() -> None:
    refusal = fly(several_faults, spacing_m=2.0, quirks=Quirks())
    assert refusal.kind is RefusedError
    assert "d1: battery at 20%, at least 25% is needed" in refusal.text
    assert "d2: system id 2 at 10.0.0.2:14580 and at 10.0.1.2:14580" in refusal.text
    for one, other in (("d1", "d2"), ("d1", "d3"), ("d2", "d4"), ("d3", "d4")):
        assert f"{one}: stands " in refusal.text
        assert f"m from {other}, at least 4.3 m is needed with a 3D fix of 0.9 m" in refusal.text
    assert "m farther apart, or use RTK (3.7 m)" in refusal.text
    assert refusal.plan_kept


async def odd_choices(show: VirtualShow) -> dict[str, RefusedCall]:
    show.ports.silence("d4")
    await show.standby()
    x_m, y_m, _ = show.true_m[1].tolist()
    tower = Obstacle("tower", x_m, y_m, 0.5, 0.5, 10.0)
    found = {
        "offline": await refused(show, start_of("d1", "d4")(show)),
        "unknown": await refused(show, start_of("d1", "d7")(show)),
        "stop": await refused(show, lambda: show.service.commands.command_show(ShowAction.STOP)),
        "abort": await refused(show, lambda: show.service.commands.command_show(ShowAction.ABORT)),
        "pause": await refused(show, lambda: show.service.commands.command_show(ShowAction.PAUSE)),
    }
    found["radius"] = await refused(show, lambda: show.service.plan.set_formation(Formation(2.0, 14.0)))
    show.service.plan.add_obstacle(tower)
    found["pad"] = await refused(show, start_of("d1", "d2", "d3")(show))
    show.ports.silence(*show.config.ids)
    await show.until(lambda: all(seen.phase is Phase.OFFLINE for seen in vehicles_of(show.view)))
    found["none"] = await refused(show, start_of()(show))
    return found


@pytest.fixture(scope="module")
def odd() -> dict[str, RefusedCall]:
    return fly(odd_choices)


@pytest.mark.parametrize(
    ("name", "kind", "says"),
    [
        ("offline", RefusedError, "d4: offline: not received yet"),
        ("unknown", UnknownError, "there is no vehicle d7; there are d1, d2, d3, d4"),
        ("stop", RefusedError, "not possible while the show is idle"),
        ("abort", RefusedError, "not possible while the show is idle"),
        ("pause", RefusedError, "it is from aborting, arming, assembling, paused"),
        ("radius", InvalidError, "at least 4.2 m for 3 vehicles"),
        ("pad", RefusedError, "d2"),
        ("none", RefusedError, "d1, d2, d3: offline: no telemetry for "),
    ],
)
def test_impossible_start_is_refused_with_its_reason(
    odd: dict[str, RefusedCall], name: str, kind: type[GcsError], says: str
) -> None:
    assert odd[name].kind is kind
    assert says in odd[name].text
    assert odd[name].plan_kept


class Start(NamedTuple):
    track: FlownTrack
    started: CommandRecord
    running: bool


async def chosen_only(show: VirtualShow) -> Start:
    await show.standby()
    record = show.service.commands.command_show(ShowAction.START, ["d1", "d3"])
    await show.reach(ShowPhase.RUNNING)
    return Start(show.track, show.service.command_log.get(record.id), running=True)


@pytest.mark.soak
def test_only_chosen_vehicles_take_off_and_others_are_named() -> None:
    start = fly(chosen_only, show_config(3))
    outcomes = start.started.outcomes
    assert {outcomes[name].outcome for name in ("d1", "d3")} == {Outcome.DONE}
    assert outcomes["d2"].outcome is Outcome.NOT_INCLUDED
    assert outcomes["d2"].reason == "not chosen"
    assert -start.track.true_m[:, 1, 2].min() < 0.1


def does_not_arm(show: VirtualShow) -> None:
    """A sensor fails between the check and the vehicle's turn."""
    show.fleet.state.ready_at_s[show.autopilot("d2").row] = np.inf


def does_not_climb(show: VirtualShow) -> None:
    """It arms, and demands no more than a hover."""
    show.autopilot("d2").parameters.set("MPC_TKO_SPEED", 0.1)


def falls_silent(show: VirtualShow) -> None:
    """It receives nothing of its turn, and no report of it arrives."""
    show.ports.silence("d2")


@pytest.mark.soak
@pytest.mark.parametrize(
    ("fault", "says"),
    [
        (does_not_arm, "d2: its autopilot does not yet pass its own arming checks"),
        (does_not_climb, "d2 is standby now"),
        (falls_silent, "d2: no position for 2."),
    ],
)
def test_failed_climb_is_reported_and_the_others_fly(fault: Callable[[VirtualShow], Any], says: str) -> None:
    async def story(show: VirtualShow) -> Start:
        await show.standby()
        record = show.service.commands.command_show(ShowAction.START)
        fault(show)
        await show.reach(ShowPhase.RUNNING)
        return Start(show.track, show.service.command_log.get(record.id), running=True)

    start = fly(story, show_config(3), quirks=Quirks())
    outcomes = start.started.outcomes
    assert {outcomes[name].outcome for name in ("d1", "d3")} == {Outcome.DONE}
    assert outcomes["d2"].outcome is Outcome.FAILED
    assert says in outcomes["d2"].reason
    assert start.track.of("d2")[-1].phase in {Phase.STANDBY, Phase.OFFLINE}
    assert [seen.phase for seen in vehicles_of(start.track.samples[-1].view)][::2] == [Phase.FORMATION] * 2


async def holds_below(show: VirtualShow) -> Start:
    """An autopilot ends its climb below the height that was ordered, by its own, poorer, altimeter."""
    await show.standby()
    record = show.service.commands.command_show(ShowAction.START)
    await show.until(lambda: show.vehicle("d2").mode is Mode.TAKEOFF)
    await show.until(lambda: -show.true_m[1, 2] > 1.0)  # its goal is set
    show.fleet.state.target_m[1, 2] += 1.0
    await show.reach(ShowPhase.ASSEMBLING)
    return Start(show.track, show.service.command_log.get(record.id), running=True)


@pytest.mark.soak
def test_vehicle_holding_slightly_below_its_height_is_up() -> None:
    start = fly(holds_below, show_config(3), ideal=True)  # it is lower by centimetres
    assert start.started.outcome is Outcome.DONE
    assert -start.track.true_m[:, 1, 2].min() < 0.9 * TAKEOFF_HEIGHT_M, "it was lower than ordered"


async def none_takes_off(show: VirtualShow) -> Start:
    await show.standby()
    record = show.service.commands.command_show(ShowAction.START)
    show.fleet.state.ready_at_s[:] = np.inf
    await show.reach(ShowPhase.LANDED)
    await show.wait(0.1)
    return Start(show.track, show.service.command_log.get(record.id), running=False)


@pytest.mark.soak
def test_show_in_which_no_vehicle_climbs_is_over() -> None:
    start = fly(none_takes_off, show_config(2))
    assert start.started.outcome is Outcome.FAILED
    assert start.track.samples[-1].view.reason == "no vehicle took off"


class Arming(NamedTuple):
    too_small: RefusedCall
    held: CommandRecord
    phase: Phase


async def changes_on_the_way_up(show: VirtualShow) -> Arming:
    """One is up and holds, the second climbs, the others wait on their pads."""
    await show.standby()
    show.service.commands.command_show(ShowAction.START)
    await show.phase("d1", Phase.TAKEOFF)
    too_small = await refused(show, lambda: show.service.plan.set_formation(Formation(2.0, 14.0)))
    held = await show.command("d1", VehicleAction.HOLD)
    return Arming(too_small, held, show.vehicle("d1").phase)


@pytest.fixture(scope="module")
def arming() -> Arming:
    return fly(changes_on_the_way_up, show_config(4, operation={"takeoff_stagger_s": 4.0}))


@pytest.mark.soak
def test_waiting_vehicles_count_for_the_smallest_radius(arming: Arming) -> None:
    assert arming.too_small.kind is InvalidError
    assert "for 4 vehicles" in arming.too_small.text


def test_a_climb_can_be_stopped_in_hold(arming: Arming) -> None:
    assert arming.held.outcome is Outcome.DONE
    assert arming.phase is Phase.HOLD


async def crate_on_a_waiting_pad(show: VirtualShow) -> tuple[CommandRecord, Array]:
    """It comes while the first climbs, beside the third's pad and onto that of the last."""
    await show.standby()
    record = show.service.commands.command_show(ShowAction.START)
    await show.phase("d1", Phase.TAKEOFF)
    pad_m = show.true_m[3]
    show.service.plan.add_obstacle(Obstacle("crate", float(pad_m[0]), float(pad_m[1]), 0.5, 0.5, 1.0))
    await show.reach(ShowPhase.RUNNING, 90.0)
    return show.service.command_log.get(record.id), show.true_m


def test_vehicle_under_an_obstacle_does_not_take_off() -> None:
    record, true_m = fly(crate_on_a_waiting_pad, show_config(4))
    assert record.outcomes["d4"].outcome is Outcome.FAILED
    assert "obstacle crate would stand on the landing place of d4" in record.outcomes["d4"].reason
    assert [record.outcomes[name].outcome for name in ("d1", "d2")] == [Outcome.DONE] * 2
    assert -true_m[3, 2] < 0.5


async def above_each_other(show: VirtualShow) -> tuple[str, int, list[str]]:
    """Before take-off the notice; then, in truth, how many pairs are stacked."""
    await show.standby()
    show.service.commands.command_show(ShowAction.START)
    await show.reach(ShowPhase.ARMING)
    assert not any(any(sample.armed) for sample in show.track.samples), "no vehicle has left the ground"
    await show.until(lambda: any("are stacked" in text for text in alarm_texts(show)), 1.0)
    (notice,) = alarm_texts(show)
    await show.reach(ShowPhase.RUNNING)
    await show.wait(8.0)
    width_m = column_m(show.config.control.safety.floor)
    return notice, len(overlapping(show.true_m, width_m)[0]), alarm_texts(show)


@pytest.mark.soak
def test_vertical_overlap_is_known_before_takeoff() -> None:
    notice, pairs, notices = fly(above_each_other, show_config(8, formation={"radius_m": 7.0}))
    reported = int(notice.split("up to ")[1].split(" ")[0])
    assert 0 < reported <= 8
    assert pairs <= reported
    assert notice not in notices, "in the air it is no notice"
