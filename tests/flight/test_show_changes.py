"""Pause, resume, and everything that may be changed while the show flies: followed, without a jump."""

from typing import NamedTuple

import numpy as np
import pytest

from gcs.model.errors import InvalidError, RefusedError, UnknownError
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Direction, Formation, Obstacle, Orbit, Plan, Target, Yaw, YawPolicy
from gcs.model.state import Array
from gcs.service import ShowAction
from gcs.testing.virtual_show import (
    HEIGHT_M,
    JUMP_M_S,
    RADIUS_M,
    FlownTrack,
    RefusedCall,
    VirtualShow,
    fly,
    refused,
)
from tests.support.show_phases import running

LARGER_M, HIGHER_M = 8.0, 17.0
BOX = Obstacle("mast", x_m=17.0, y_m=1.0, half_length_x_m=1.0, half_length_y_m=1.0, height_m=40.0)


class Flight(NamedTuple):
    track: FlownTrack
    paused: FlownTrack
    resumed: FlownTrack
    re_formed_s: float  # how long it took
    larger: FlownTrack
    higher: FlownTrack
    target: FlownTrack
    past_the_mast: FlownTrack
    mast_m: Array  # (k, n) distance of every vehicle from the mast, tick by tick
    orbiting: FlownTrack
    plans: dict[str, Plan]
    refusals: dict[str, RefusedCall]
    floor_violations: int


async def refusals(show: VirtualShow) -> dict[str, RefusedCall]:
    """Everything that must be turned down while four fly."""
    service, at = show.service, show.true_m[1]
    over = Obstacle("over", float(at[0]), float(at[1]), 0.5, 0.5, 30.0)
    requests = {
        "too small": lambda: service.plan.set_formation(Formation(2.0, HEIGHT_M)),
        "too low": lambda: service.plan.set_formation(Formation(LARGER_M, 10.0)),
        "too high": lambda: service.plan.set_formation(Formation(LARGER_M, 95.0)),
        "orbit too fast": lambda: service.plan.set_orbit(Orbit(10.0, 9.0)),
        "orbit too tight": lambda: service.plan.set_orbit(Orbit(1.0, 3.0)),
        "target too fast": lambda: service.plan.set_target(Target(0.0, 0.0, 9.0, 0.0)),
        "target too far": lambda: service.plan.set_target(Target(400.0, 0.0)),
        "taken id": lambda: service.plan.add_obstacle(BOX),
        "no such obstacle": lambda: service.plan.remove_obstacle("tree"),
        "changed, not there": lambda: service.plan.change_obstacle(over),
        "resume": lambda: service.commands.command_show(ShowAction.RESUME),
        "start": lambda: service.commands.command_show(ShowAction.START),
        "chosen stop": lambda: service.commands.command_show(ShowAction.STOP, ["d1"]),
        "unknown order": lambda: service.command_log.get("o999"),
    }
    return {name: await refused(show, request) for name, request in requests.items()}


async def story(show: VirtualShow) -> Flight:
    service, plans = show.service, {}

    async def after(seconds: float) -> FlownTrack:
        """What the next seconds bring."""
        began_s = show.now_s
        await show.wait(seconds)
        return show.track.between(began_s)

    await show.start()
    service.plan.set_orbit(Orbit(5.0, 2.0))
    await show.wait(8.0)
    service.commands.command_show(ShowAction.PAUSE)
    paused = await after(6.0)
    began_s = show.now_s
    service.commands.command_show(ShowAction.RESUME)
    re_formed_s = await show.reach(ShowPhase.RUNNING)
    await show.wait(3.0)
    resumed = show.track.between(began_s)
    service.plan.set_orbit(Orbit(0.0, 2.0))
    service.plan.set_formation(Formation(LARGER_M, HEIGHT_M))
    larger = await after(9.0)
    plans["larger"] = show.view.plan
    service.plan.set_formation(Formation(LARGER_M, HIGHER_M))
    higher = await after(9.0)
    service.plan.set_yaw(Yaw(YawPolicy.TARGET))
    service.plan.add_obstacle(BOX)
    service.plan.set_target(Target(31.0, 1.0))
    past = await after(30.0)
    inside_m = np.array([show.ellipse("mast").distance_m(sample.true_m) for sample in past.samples])
    plans["mast"] = show.view.plan
    turned_down = await refusals(show)
    service.plan.remove_obstacle("mast")
    service.plan.set_orbit(Orbit(6.0, 2.0, Direction.CLOCKWISE))
    service.plan.set_target(Target(31.0, 1.0, 0.5, 0.0))
    orbiting = await after(15.0)
    plans["end"] = show.view.plan
    return Flight(
        show.track,
        paused,
        resumed,
        re_formed_s,
        larger,
        higher,
        past.between(past.time_s[-1] - 3.0),
        past,
        inside_m,
        orbiting,
        plans,
        turned_down,
        show.floor_violations(),
    )


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(story)


@pytest.fixture(scope="module")
def exact_flight() -> Flight:
    """The same without errors of estimates, for where the centre is."""
    return fly(story, ideal=True)


def sphere_error_m(track: FlownTrack, center_m: tuple[float, float, float], radius_m: float) -> float:
    """How far the worst vehicle truly is from the sphere at the end."""
    off_m = np.linalg.norm(track.true_m[-20:] - np.array(center_m), axis=2) - radius_m
    return float(np.abs(off_m).max())


def test_pause_stops_every_vehicle_in_place(flight: Flight) -> None:
    stopped = flight.paused.between(flight.paused.time_s[0] + 3.0)
    strayed_m = np.linalg.norm(stopped.true_m - stopped.true_m[0], axis=2)
    assert strayed_m.max() < 1.0  # the fake's own position error wanders
    assert {sample.view.show for sample in stopped.samples} == {ShowPhase.PAUSED}


def test_pause_stops_the_vehicles_within_a_few_metres(flight: Flight) -> None:
    gone_m = np.linalg.norm(flight.paused.true_m - flight.paused.true_m[0], axis=2)
    assert gone_m.max() < 3.5


def test_setpoints_continue_to_all_vehicles_while_paused(flight: Flight) -> None:
    assert np.isfinite(flight.paused.setpoint_m_s[2:]).all()


def test_resume_re_forms_and_goes_on(flight: Flight) -> None:
    assert flight.resumed.show_phases()[-1] is ShowPhase.RUNNING
    assert flight.re_formed_s < 5.0
    centroid_m = flight.resumed.true_m.mean(axis=1)[:, :2]
    assert np.hypot(*(centroid_m[-1] - centroid_m[0])) > 2.0


def test_a_larger_radius_is_followed(flight: Flight) -> None:
    center_m = flight.larger.samples[-1].view.center_m
    assert center_m is not None
    assert flight.plans["larger"].formation == Formation(LARGER_M, HEIGHT_M)
    assert sphere_error_m(flight.larger, center_m, LARGER_M) < 1.5


def test_the_commanded_radius_glides_instead_of_jumping(flight: Flight) -> None:
    radius_m = np.array([sample.view.radius_m for sample in flight.larger.samples], dtype=np.float64)
    assert radius_m[0] == pytest.approx(RADIUS_M, abs=0.1)
    assert np.abs(np.diff(radius_m)).max() <= 0.05 + 1e-9  # 1 m/s at 20 Hz
    assert radius_m[-1] == pytest.approx(LARGER_M)


def test_a_greater_height_is_followed(flight: Flight) -> None:
    height_m = -flight.higher.true_m[-20:, :, 2].mean()
    assert height_m == pytest.approx(HIGHER_M, abs=0.8)


@pytest.mark.soak
def test_a_new_target_is_flown_to(exact_flight: Flight) -> None:
    centroid_m = exact_flight.target.true_m[-20:].mean(axis=(0, 1))
    assert centroid_m[:2] == pytest.approx((31.0, 1.0), abs=1.0)


def test_an_obstacle_on_the_way_is_flown_around(flight: Flight) -> None:
    began_m = flight.past_the_mast.true_m[0, :, 0]
    assert began_m.max() < BOX.x_m < flight.target.true_m[-1, :, 0].min()
    assert flight.mast_m.min() > 0.3  # from the ellipse around the box itself, without any margin


def test_a_moving_target_is_circled_the_other_way_round(flight: Flight) -> None:
    last = flight.orbiting.between(flight.orbiting.time_s[-1] - 3.0)
    target_m = np.array([sample.view.target_m for sample in last.samples])
    offset_m = last.true_m.mean(axis=1)[:, :2] - target_m
    assert np.hypot(*offset_m.T) == pytest.approx(np.full(len(offset_m), 6.0), abs=1.5)
    bearing_rad = np.unwrap(np.arctan2(offset_m[:, 1], offset_m[:, 0]))
    assert bearing_rad[-1] > bearing_rad[0] + 0.5  # clockwise from above: x towards y, with z down


def test_no_change_makes_a_setpoint_jump(flight: Flight) -> None:
    assert flight.track.hardest_change_m_s() < JUMP_M_S


def test_true_separation_keeps_the_floor_during_changes(flight: Flight) -> None:
    assert flight.floor_violations == 0


@pytest.mark.parametrize(
    ("name", "kind", "says"),
    [
        ("too small", InvalidError, "at least 4.7 m for 4 vehicles"),
        ("too low", InvalidError, "at least 11.0 m"),
        ("too high", InvalidError, "at most 92.0 m"),
        ("orbit too fast", InvalidError, "at most the centre's 4 m/s"),
        ("orbit too tight", InvalidError, "at least 9.0 m"),
        ("target too fast", InvalidError, "at most 6.4 m/s"),
        ("target too far", InvalidError, "within"),
        ("taken id", RefusedError, "there is an obstacle mast already"),
        ("no such obstacle", UnknownError, "there are mast"),
        ("changed, not there", UnknownError, "no obstacle over"),
        ("resume", RefusedError, "it is from paused"),
        ("start", RefusedError, "it is from countdown, idle, landed"),
        ("chosen stop", InvalidError, "only with start"),
        ("unknown order", UnknownError, "no command o999"),
    ],
)
def test_infeasible_changes_are_refused_with_what_fits(
    flight: Flight, name: str, kind: type[Exception], says: str
) -> None:
    refusal = flight.refusals[name]
    assert refusal.kind is kind
    assert says in refusal.text
    assert refusal.plan_kept


async def smallest(show: VirtualShow) -> tuple[RefusedCall, tuple[float, int]]:
    refusal = await refused(show, lambda: show.service.plan.set_formation(Formation(1.0, HEIGHT_M)))
    reported_m = float(refusal.text.split("at least ")[1].split(" m")[0])
    show.service.plan.set_formation(Formation(reported_m, HEIGHT_M))
    await show.wait(10.0)
    return refusal, (reported_m, show.floor_violations())


@pytest.mark.soak
def test_smallest_named_radius_is_accepted_and_keeps_the_floor() -> None:
    refusal, (reported_m, violations) = fly(smallest, after=running)
    assert refusal.kind is InvalidError
    assert reported_m == 4.7
    assert violations == 0
