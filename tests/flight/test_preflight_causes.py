"""Preflight names causes first: following its actions literally, the first one first, leads to ready."""

import random
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple, TypeAlias

import pytest

from gcs.estimation.pad_places import SETTLES_S
from gcs.model.plan import Formation, Obstacle
from gcs.model.preflight_report import READY, PreflightAction, PreflightReport, Remedy
from gcs.model.state import VehicleId
from gcs.service import VehicleAction
from gcs.testing.virtual_show import VirtualShow, fly, show_config

COUNT: Final = 60
RADIUS_M, HEIGHT_M = 24.0, 30.0
RECEIVED_S, SILENT_S = 2.5, 4.5
"""Whatever befalls a vehicle has been received by then; a silent one is offline."""

MENDED_MAX_S: Final = 35.0
"""What was mended is good by then: a position that jumped back must be steady for 10 s."""

TRIPLES: Final = 30
"""In `make soak`; six in `make test`."""

Befall: TypeAlias = Callable[[VirtualShow, VehicleId], object]


def fault(name: str, **values: float | str) -> Befall:
    """A fault of the fake fleet."""
    return lambda show, vehicle: show.befall(vehicle, name, **values)


def obstacle(show: VirtualShow, vehicle: VehicleId) -> None:
    """Somebody adds an obstacle on a pad."""
    x_m, y_m, _ = show.true_m[show.config.ids.index(vehicle)].tolist()
    show.service.plan.add_obstacle(Obstacle(f"on-{vehicle}", x_m, y_m, 0.5, 0.5, 4.0))


def mistune(show: VirtualShow, vehicle: VehicleId) -> None:
    """Somebody changes a parameter; the vehicle restarts."""
    show.autopilot(vehicle).parameters.set("GF_ACTION", 0)
    show.befall(vehicle, "reboot", off_s=4.0)


CAUSES: Final[dict[str, tuple[Befall, str]]] = {
    "2D fix": (fault("fix", type="2d"), "fix"),
    "no fix": (fault("fix", type="none"), "fix"),
    "no receiver": (fault("fix", type="no-gps"), "fix"),
    "no accuracy": (fault("accuracy", eph_m=9.0, epv_m=18.0), "accuracy sideways"),
    "little accuracy": (fault("accuracy", eph_m=4.0, epv_m=8.0), "distance to the next"),
    "gyroscope": (fault("sensor", which="gyro"), "autopilot"),
    "accelerometer": (fault("sensor", which="accelerometer"), "autopilot"),
    "magnetometer": (fault("sensor", which="magnetometer"), "autopilot"),
    "barometer": (fault("sensor", which="barometer"), "autopilot"),
    "receiver unhealthy": (fault("sensor", which="gps"), "autopilot"),
    "battery low": (fault("battery", remaining=0.18), "battery"),
    "battery empty": (fault("battery", remaining=0.03), "battery"),
    "clock ahead": (fault("wrong-time", ahead_s=60.0), "clock"),
    "clock behind": (fault("wrong-time", ahead_s=-60.0), "clock"),
    "silent": (fault("silence"), "received"),
    "pad too high": (fault("gps-jump", down_m=-2.8), "jump"),
    "another datum": (fault("gps-jump", down_m=-6.0), "jump"),
    "beside another": (fault("gps-jump", north_m=2.5), "jump"),
    "id used twice": (lambda show, vehicle: show.ports.duplicated.add(vehicle), "address"),
    "obstacle on its pad": (obstacle, "obstacles"),
}


def undo(show: VirtualShow, vehicles: Sequence[VehicleId]) -> None:
    """Mend everything, as people on the field do after the test."""
    for vehicle in vehicles:
        show.befall(vehicle, "none")
    show.ports.duplicated.clear()
    for each in show.service.plan.current.obstacles:
        show.service.plan.remove_obstacle(each.id)
    for vehicle in report(show).not_flying:
        show.service.preflight.include(vehicle)


def report(show: VirtualShow) -> PreflightReport:
    """As of now: a report is made at most once a second."""
    show.service.preflight._last = None
    return show.service.preflight.report()


def follow(show: VirtualShow, action: PreflightAction) -> None:
    """Give the one command that an action is, to each of its vehicles."""
    service = show.service
    match action.remedy:
        case Remedy.LEAVE_OUT:
            for vehicle in action.vehicles:
                service.preflight.exclude(vehicle, "fails preflight")
        case Remedy.SET_RADIUS:
            assert action.radius_m is not None
            service.plan.set_formation(Formation(action.radius_m, HEIGHT_M), ["radius_m"])
        case Remedy.REMOVE_OBSTACLE:
            service.plan.remove_obstacle(action.obstacle)
        case Remedy.CONFIRM_DOWN:
            for vehicle in action.vehicles:
                service.commands.command_vehicle(vehicle, VehicleAction.CONFIRM_DOWN)


class Followed(NamedTuple):
    """What preflight showed for some causes, and how often its first action was followed."""

    first: PreflightReport
    actions: int
    last: PreflightReport


async def followed(show: VirtualShow) -> Followed:
    """Do what the first block says, until the report is ready or names nothing to do."""
    first = now = report(show)
    actions = 0
    while not now.passes and now.causes and now.causes[0].action is not None and actions < COUNT:
        promised, before = now.causes[0].action.then, len(now.causes)
        follow(show, now.causes[0].action)
        actions += 1
        now = report(show)
        assert now.passes == (promised == READY), (promised, before, now.causes)
    return Followed(first, actions, now)


def described(found: PreflightReport) -> list[str]:
    """Each block in a line."""
    return [
        f"{one.text} -> {one.action and one.action.label}: {one.action and one.action.then}"
        for one in found.causes
    ]


@pytest.mark.soak
@pytest.mark.parametrize("count", [6, pytest.param(TRIPLES, marks=pytest.mark.soak)])
def test_whoever_follows_the_actions_gets_ready(count: int) -> None:
    config = show_config(COUNT, formation={"radius_m": RADIUS_M, "height_m": HEIGHT_M}).model_copy(
        update={"tick_rate_hz": 10.0}
    )
    singles: dict[str, Followed] = {}
    triples: list[tuple[tuple[str, ...], Followed]] = []
    chance = random.Random(50)

    async def tried(show: VirtualShow, names: Sequence[str], vehicles: Sequence[VehicleId]) -> Followed:
        for name, vehicle in zip(names, vehicles, strict=True):
            CAUSES[name][0](show, vehicle)
        await show.wait(SILENT_S if "silent" in names else RECEIVED_S)
        found = await followed(show)
        undo(show, vehicles)
        mended_s = show.now_s
        while not report(show).passes:
            assert show.now_s < mended_s + MENDED_MAX_S, described(report(show))
            await show.wait(1.0)
        return found

    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.wait(SETTLES_S + 1.0)
        for name in CAUSES:
            singles[name] = await tried(show, [name], [chance.choice(show.config.ids)])
        for _ in range(count):
            names = tuple(chance.sample(list(CAUSES), 3))
            triples.append((names, await tried(show, names, chance.sample(show.config.ids, 3))))

    fly(story, config, ideal=True, grid_columns=8, grid_at_m=(-17.5, -17.5))
    for name, found in singles.items():
        shown = described(found.first)
        assert found.last.passes, (name, shown, described(found.last))
        assert len(found.first.causes) <= 2, (name, shown)
        assert found.first.causes[0].check == CAUSES[name][1], (name, shown)
    for names, found in triples:
        shown = described(found.first)
        assert found.last.passes, (names, shown, described(found.last))
        assert len(found.first.causes) <= len(names) + 1, (names, shown)
