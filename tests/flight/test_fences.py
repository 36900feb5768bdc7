"""Fences in the autopilots: uploaded on the ground, verified, demanded before a start, watched in flight."""

import asyncio
from contextlib import suppress
from typing import Any, Final, cast

import pytest

from gcs.config.schema import Config
from gcs.flight.features.fences import FenceUploads
from gcs.flight.orchestrator import Orchestrator
from gcs.links.link import FrameDirection
from gcs.links.settings import EXTRA_BYTES_PER_S
from gcs.mavlink.fences import vertices_of
from gcs.model.errors import RefusedError
from gcs.model.preflight_report import Check
from gcs.service import ShowAction
from gcs.service.alarms import AlarmCause
from gcs.sim.fleet import Fleet
from gcs.sim.mixed import fleet_of
from gcs.sim.protocol.fences import NO_HOME, Item, Px4Fences
from gcs.sim.settings import Settings
from gcs.sim.vehicle.px4 import Quirks
from gcs.testing.virtual_link import STREAMS_HZ, VirtualLink
from gcs.testing.virtual_show import READY_AT_ONCE, VirtualShow, begin_of, fly, refused, show_config
from gcs.testing.virtual_time import AtOnce, UnixClock, run_virtual
from tests.support.site_fences import at_deg, fenced, many_cornered, square

HOLE = square(5.0, north_m=60.0, inclusion=False)
WIDE = square(80.0)
MISSION: Final = range(40, 74)
"""Messages of the mission protocol, by which fences go."""


def mixed_config(count: int = 4) -> Config:
    """PX4 and ArduCopter in turn."""
    raw = show_config(count, operation={"setpoint_loss_action": "hold", "setpoint_loss_s": 3.0}).model_dump()
    raw["links"][0]["transport"] = "native"
    vehicles = [each.model_dump() for each in show_config(count).fleet]
    kinds = ("px4", "ardupilot")
    raw["links"][0]["vehicles"] = [one | {"autopilot": kinds[row % 2]} for row, one in enumerate(vehicles)]
    return Config.model_validate(raw)


def uploads(show: VirtualShow) -> FenceUploads:
    return next(each for each in show.service.flight.features if isinstance(each, FenceUploads))


def fence_check(show: VirtualShow, name: str) -> Check:
    report = show.service.preflight.report()
    vehicle = next(each for each in report.vehicles if each.id == name)
    return next(each for each in vehicle.checks if each.name == "uploaded fence")


async def verified(show: VirtualShow, limit_s: float = 20.0) -> float:
    """Wait until all have the fence."""
    count = len(show.config.ids)

    def all_have() -> bool:
        view = show.view.features.fences
        return view is not None and view.verified == count

    try:
        return await show.until(all_have, limit_s)
    except TimeoutError as error:
        raise AssertionError(show.view.features.fences) from error


def stored(show: VirtualShow, row: int) -> list[tuple[int, int, int, int]]:
    items: tuple[Item, ...] = show.fleet.autopilots[row].fences.items
    return [(each.command, each.corners, each.x, each.y) for each in items]


def in_alarm(show: VirtualShow, cause: AlarmCause) -> set[str]:
    return {
        name for alarm in show.view.alarms if alarm.cause is cause and alarm.lasts for name in alarm.vehicles
    }


def test_both_autopilots_get_the_fence_and_a_start_needs_it() -> None:
    async def story(show: VirtualShow) -> None:
        refusal = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
        assert refusal.kind is RefusedError
        await show.standby()
        await verified(show)
        assert show.config.polygon_fence is not None
        expected = [tuple(each) for each in vertices_of(show.config.polygon_fence)]
        for row in range(4):
            assert stored(show, row) == expected
            assert fence_check(show, show.config.ids[row]).passes
        await show.start()
        assert in_alarm(show, AlarmCause.FENCE_DIFFERS) == set()

    fly(story, fenced(mixed_config(), WIDE, HOLE))


@pytest.mark.soak
def test_another_fence_is_replaced_and_then_refused_by_name() -> None:
    """A second station sends its own fence again and again, until it is ended."""

    async def story(show: VirtualShow) -> None:
        await show.standby()
        await verified(show)
        other = show.fleet.autopilots[1].fences
        for _ in range(3 * 35 * 2):
            if len(other.items) == 8:
                other.keep(other.items[:4])
            await show.wait(0.5)
        check = fence_check(show, "d2")
        assert check.problem == (
            "it has another fence: 4 corners, 8 are needed, though it was uploaded 3 times"
        )
        assert check.to_do.startswith("end the other station")
        refusal = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
        assert "d2: it has another fence" in refusal.text
        view = show.view.features.fences
        assert view is not None
        assert (view.verified, view.missing) == (3, f"d2: {check.problem}")
        show.befall("d2", "reboot", off_s=4.0)
        await show.wait(5.0)
        await verified(show)
        assert len(stored(show, 1)) == 8

    fly(story, fenced(mixed_config(), WIDE, HOLE))


@pytest.mark.soak
def test_px4_reports_a_changed_fence_within_seconds() -> None:
    """By the identity in MISSION_CURRENT; in flight that is an alarm, and nothing is uploaded."""

    async def story(show: VirtualShow) -> None:
        await show.standby()
        await verified(show)
        await show.wait(3.0)
        await show.start()
        other = show.fleet.autopilots[2].fences
        other.keep(other.items[:4])
        await show.until(lambda: in_alarm(show, AlarmCause.FENCE_DIFFERS) == {"d3"}, 5.0)
        await show.wait(5.0)
        assert len(stored(show, 2)) == 4

    rates_hz = {**STREAMS_HZ, 42: 1.0}
    fly(story, fenced(show_config(4), WIDE, HOLE), rates_hz=rates_hz)


@pytest.mark.soak
def test_a_late_identity_of_the_old_fence_is_no_change() -> None:
    """As a vehicle sends it while it is given the site's. Another's fence is a change."""

    async def story(show: VirtualShow) -> None:
        await show.standby()
        await verified(show)
        known, link = uploads(show), show.link
        own_id = link.fences.reported_id[1]
        upload = known._of["d2"]
        upload.reported_id, upload.uploads = 77, 3
        await show.wait(2.0)
        assert (upload.verified, upload.reported_id) == (True, own_id)
        await show.wait(32.0)
        assert (upload.verified, upload.uploads) == (True, 0)
        other = show.fleet.autopilots[1].fences
        other.keep(other.items[:4])
        await show.until(lambda: not upload.verified, 3.0)
        await verified(show)
        assert len(stored(show, 1)) == 8

    rates_hz = {**STREAMS_HZ, 42: 1.0}
    fly(story, fenced(show_config(2), WIDE, HOLE), rates_hz=rates_hz)


@pytest.mark.soak
def test_a_vehicle_outside_the_site_gets_no_fence() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.wait(3.0)
        check = fence_check(show, "d4")
        assert not check.passes
        assert "it stands" in check.problem
        assert "outside the inclusion" in check.problem
        assert stored(show, 3) == []
        assert fence_check(show, "d1").passes

    fly(story, fenced(show_config(4), square(4.0)))


@pytest.mark.soak
def test_px4_with_home_outside_is_not_believed_to_have_the_fence() -> None:
    """It acknowledges, and sends back, a fence that it does not fly."""

    async def story(show: VirtualShow) -> None:
        await show.wait(0.2)
        show.fleet.state.home_place[0, 0] += 0.01
        await show.standby()
        await show.wait(40.0)
        check = fence_check(show, "d1")
        assert "its home is 10" in check.problem
        assert "m outside the inclusion" in check.problem
        assert check.to_do.startswith("reboot the vehicle where it stands")
        assert fence_check(show, "d2").passes
        show.befall("d1", "reboot", off_s=1.0)
        await verified(show)
        assert len(show.fleet.autopilots[0].fences.in_force) == 1

    fly(story, fenced(show_config(4), WIDE))


@pytest.mark.soak
def test_px4_that_says_it_left_out_an_area_is_refused() -> None:
    """Home moves while the fence is under way."""

    async def story(show: VirtualShow) -> None:
        await show.wait(0.3)
        fences = show.fleet.autopilots[0].fences
        assert isinstance(fences, Px4Fences)
        fences._must_contain = lambda: [(NO_HOME, at_deg(500.0, 0.0))]
        await show.until(lambda: 'it says "' in fence_check(show, "d1").problem, 12.0)
        assert NO_HOME in fence_check(show, "d1").problem
        assert (len(fences.items), fences.in_force) == (4, ())
        await show.wait(40.0)
        assert not fence_check(show, "d1").passes
        assert fence_check(show, "d2").passes

    fly(story, fenced(show_config(4), WIDE), quirks=Quirks(late_ready=False, quiet_texts=False))


@pytest.mark.keeps("1.16-64")
@pytest.mark.parametrize(("version", "most"), [("1.14", 63), ("1.16", 64), ("4.1", 83)])
def test_too_many_corners_are_refused_before_anything_is_sent(version: str, most: int) -> None:
    raw = show_config(2).model_dump()
    if version.startswith("4"):
        raw["links"][0]["transport"] = "native"
        raw["links"][0]["autopilot"] = "ardupilot"
    config = Config.model_validate(raw)

    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.wait(4.0)
        assert f"takes {most} in all" in fence_check(show, "d1").problem
        assert stored(show, 0) == []

    usual: dict[str, Any] = {"version": version} if version.startswith("1") else {}
    fly(story, fenced(config, many_cornered(most + 1, 80.0)), **usual)


@pytest.mark.alternates(0)
@pytest.mark.parametrize(
    ("autopilot", "parameter", "mode"),
    [("px4", ("GF_ACTION", 2), "hold"), ("ardupilot", ("FENCE_ACTION", 4), "hold")],
)
def test_a_breach_is_an_alarm_and_the_autopilot_acts(
    autopilot: str, parameter: tuple[str, int], mode: str
) -> None:
    """A receiver that is 30 m off: the autopilot sees itself outside."""
    raw = show_config(2).model_dump()
    if autopilot == "ardupilot":
        raw["links"][0]["transport"] = "native"
        raw["links"][0]["autopilot"] = autopilot
    config = Config.model_validate(raw)

    async def story(show: VirtualShow) -> None:
        await show.standby()
        await verified(show)
        await show.start()
        assert in_alarm(show, AlarmCause.OWN_FENCE) == set()
        show.befall("d2", "gps-jump", north_m=70.0)
        await show.until(lambda: in_alarm(show, AlarmCause.OWN_FENCE) == {"d2"}, 5.0)
        await show.wait(1.0)
        assert show.vehicle("d2").mode == mode

    fly(story, fenced(config, square(50.0)), parameters={parameter[0]: parameter[1]})


def many() -> Config:
    """100 vehicles of both kinds behind 4 links, with a fence of 64 corners."""
    raw = show_config(100, operation={"require_parameters": False}).model_dump()
    raw["links"] = [
        {
            "name": f"l{link}",
            "listen": f"udpin://127.0.0.1:{14540 + link}",
            "transport": "native",
            "vehicles": [
                {
                    "id": f"d{25 * link + row + 1}",
                    "system_id": row + 1,
                    "autopilot": ("px4", "ardupilot")[row % 2],
                }
                for row in range(25)
            ],
        }
        for link in range(4)
    ]
    return fenced(Config.model_validate(raw), many_cornered(64, 400.0))


async def upload_to_many() -> tuple[float, list[float]]:
    """Time until all have the fence, and bytes a second that features sent on each link meanwhile."""
    config, unix, now_s = many(), UnixClock(), asyncio.get_running_loop().time()
    links, budgets_bytes = list[VirtualLink](), [0] * 4
    for number in range(4):
        settings = Settings(
            count=25,
            autopilot="mixed",
            quirks=READY_AT_ONCE,
            rates_hz=STREAMS_HZ,
            grid_columns=5,
            grid_at_m=(40.0 * number, 0.0),
        )
        fleet = cast("Fleet", fleet_of(settings, **begin_of(now_s, unix(), 0.02)))
        link = VirtualLink(config, fleet, ids=config.ids[25 * number : 25 * number + 25])
        links.append(link)

        def count(_: float, way: FrameDirection, raw: bytes, __: int, number: int = number) -> None:
            if way is FrameDirection.SENT and int.from_bytes(raw[7:10], "little") in MISSION:
                budgets_bytes[number] += len(raw)

        link.observe(count)
    service = Orchestrator(config, links, unix_s=unix, planning=AtOnce())
    task = asyncio.create_task(service.run())
    async for view in service.view.values():
        fences, took_s = view.features.fences, view.time_s - now_s
        assert fences is not None
        if fences.verified == 100:
            break
        assert took_s < 60.0, fences.missing
    for link in links:
        for fleet in link.ports.fault_injector._fleet.parts:  # type: ignore[union-attr]
            assert {len(each.fences.items) for each in fleet.autopilots} == {64}
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
    return took_s, [each / took_s for each in budgets_bytes]


@pytest.mark.soak
def test_a_hundred_vehicles_of_both_kinds_within_20_s() -> None:
    took_s, bytes_per_s = run_virtual(upload_to_many)
    assert took_s < 20.0
    assert max(bytes_per_s) < EXTRA_BYTES_PER_S
