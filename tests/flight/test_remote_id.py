"""Remote ID in flight: the swarm's area against the true one, transponders before a start and in the air."""

import logging
from typing import Any, Final, cast

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.links.link import FrameDirection
from gcs.links.settings import EXTRA_BYTES_PER_S
from gcs.model.errors import RefusedError
from gcs.model.preflight_report import Check
from gcs.service import ShowAction
from gcs.service.alarms import AlarmCause
from gcs.service.features import RemoteIdView
from gcs.sim.autopilots.ardupilot.commander import Commander
from gcs.sim.protocol.remote_id import Transponder
from gcs.testing.virtual_show import READY_AT_ONCE, VirtualShow, fly, refused, show_config

GEOID_M: Final = 47.5
PLACE: Final = {"latitude_deg": 47.3977, "longitude_deg": 8.5456, "altitude_amsl_m": 488.0}
SETTINGS: Final = {"operator": PLACE, "geoid_m": GEOID_M, "operator_id": "CHE-op-12345", "self_id": "Show"}
REQUIRED: Final = {"COM_ARM_ODID": 2}
ENFORCED: Final = {"DID_ENABLE": 1, "DID_OPTIONS": 1}
ODID: Final = range(12900, 12920)
NEAR_M: Final = 5.0


def config(count: int = 4, **change: Any) -> Config:
    return show_config(count, remote_id=SETTINGS | change)


def by_ardupilot(count: int = 2) -> Config:
    raw = config(count).model_dump()
    link = raw["links"][0] | {"transport": "native", "autopilot": "ardupilot"}
    return Config.model_validate(raw | {"links": [link]})


def transponder(show: VirtualShow, row: int) -> Transponder:
    fitted: Transponder | None = show.fleet.autopilots[row].transponder
    assert fitted is not None
    return fitted


def shown(show: VirtualShow) -> RemoteIdView:
    view = show.view.features.remote_id
    assert view is not None
    return view


def check(show: VirtualShow, name: str) -> Check:
    vehicle = next(each for each in show.service.preflight.report().vehicles if each.id == name)
    return next(each for each in vehicle.checks if each.name == "remote id")


def in_alarm(show: VirtualShow, cause: AlarmCause = AlarmCause.REMOTE_ID) -> dict[str, str]:
    lasting = (alarm for alarm in show.view.alarms if alarm.cause is cause and alarm.lasts)
    return {name: alarm.text for alarm in lasting for name in alarm.vehicles or ("",)}


def errors_m(show: VirtualShow, rows: list[int]) -> list[float]:
    """By how much each area that these vehicles received last differs from the true one."""
    true_m = show.true_m[rows]
    apart_m = np.linalg.norm(true_m[:, None, :2] - true_m[None, :, :2], axis=2).max(axis=1)
    height_m = 488.0 + GEOID_M - true_m[:, 2]
    wrong = []
    for at, row in enumerate(rows):
        area = transponder(show, row).newest["OPEN_DRONE_ID_SYSTEM"]
        assert area["area_count"] == len(rows)
        wrong += [
            abs(area["area_radius"] - apart_m[at]),
            abs(area["area_ceiling"] - height_m.max()),
            abs(area["area_floor"] - height_m.min()),
        ]
    return wrong


@pytest.mark.soak
@pytest.mark.parametrize("count", [12, pytest.param(200, marks=pytest.mark.soak)])
def test_each_vehicle_has_the_true_area_each_second(count: int) -> None:
    wide = {"radius_m": 10.0 if count < 100 else 45.0, "height_m": 50.0}
    plan = show_config(
        count,
        remote_id=SETTINGS,
        formation=wide,
        operation={"takeoff_stagger_s": 0.05, "takeoff_height_m": 10.0, "pads_within_m": 120.0},
    )
    sent_bytes, worst_m, late_s = [0], [0.0], [0.0]

    async def story(show: VirtualShow) -> tuple[float, float, float]:
        def add(_: float, way: FrameDirection, raw: bytes, __: int) -> None:
            if way is FrameDirection.SENT and int.from_bytes(raw[7:10], "little") in ODID:
                sent_bytes[0] += len(raw)

        show.link.observe(add)
        await show.standby()
        await show.wait(3.0)
        began_s = show.view.time_s
        sent_bytes[0] = 0
        show.service.commands.command_show(ShowAction.START)
        rows = list(range(count))
        for _ in range(40 if count < 100 else 80):
            await show.wait(1.0)
            late_s[0] = max(
                late_s[0], *(show.fleet.time_s - transponder(show, row).times_s[-1] for row in rows)
            )
            if not show.fleet.state.landed.any():
                worst_m[0] = max(worst_m[0], *errors_m(show, rows))
        return worst_m[0], late_s[0], sent_bytes[0] / (show.view.time_s - began_s)

    error_m, age_s, bytes_per_s = fly(story, plan, transponders=True, quirks=READY_AT_ONCE, grid_columns=15)
    figures = f"{error_m:.2f} m, {age_s:.2f} s, {bytes_per_s:.0f} B/s"
    logging.getLogger(__name__).info(figures)
    assert 0.0 < error_m < NEAR_M, figures
    assert age_s <= 1.1
    assert bytes_per_s < EXTRA_BYTES_PER_S / 2.0


@pytest.mark.soak
def test_a_lost_vehicle_widens_the_area() -> None:
    """By all that it may do: it descends where it was, or returns."""

    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.start()
        await show.wait(10.0)
        before = shown(show)
        assert before.area_count == 4
        show.befall("d2", "silence", way="both")
        for _ in range(15):
            await show.wait(1.0)
            flying_m = show.true_m[:, :2]
            apart_m = np.linalg.norm(flying_m[:, None] - flying_m[None], axis=2)
            assert shown(show).area_count == 4
            assert shown(show).area_radius_m > apart_m.max() - 1.0
        after = shown(show)
        assert after.area_radius_m > before.area_radius_m
        assert before.area_floor_m is not None
        assert after.area_floor_m is not None
        assert before.area_floor_m > 488.0 + GEOID_M + 4.0
        assert after.area_floor_m <= 488.0 + GEOID_M

    fly(story, config(require=False))


@pytest.mark.soak
def test_all_that_transponders_need_is_sent() -> None:
    identity = {"d3": {"kind": "registration", "id": "HB-1234"}}

    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.wait(7.0)
        for row in range(4):
            newest = transponder(show, row).newest
            assert newest["OPEN_DRONE_ID_OPERATOR_ID"]["operator_id"] == "CHE-op-12345"
            assert newest["OPEN_DRONE_ID_SELF_ID"]["description"] == "Show"
            system = newest["OPEN_DRONE_ID_SYSTEM"]
            assert (system["operator_latitude"], system["operator_longitude"]) == (473977000, 85456000)
            assert system["operator_altitude_geo"] == pytest.approx(535.5)
            assert ("OPEN_DRONE_ID_BASIC_ID" in newest) is (row == 2)
        view = shown(show)
        assert (view.ready, view.missing, view.problem) == (4.0, "", "")
        assert view.sent > 0

    fly(story, config(basic_ids=identity), transponders=True)


def test_a_start_needs_each_transponder_and_names_the_vehicle() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.wait(3.0)
        assert check(show, "d2").passes
        show.befall("d2", "transponder", how="lost")
        await show.wait(5.0)
        assert check(show, "d2").problem.startswith("its transponder is silent for ")
        refusal = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
        assert refusal.kind is RefusedError
        assert "d2: its transponder is silent" in refusal.text
        show.befall("d2", "transponder", how="not-good")
        await show.wait(3.0)
        assert check(show, "d2").problem == 'its transponder is not ready: "LOC"'
        show.befall("d2", "transponder", how="lost-operator")
        await show.wait(5.0)
        assert check(show, "d2").problem == 'its transponder is not ready: "SYS OP_LOC"'

    fly(story, config(), transponders=True, parameters=REQUIRED)


@pytest.mark.soak
def test_vehicles_without_transponders_do_not_start() -> None:
    async def story(show: VirtualShow) -> None:
        await show.wait(12.0)
        refusal = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
        assert "its transponder was never received" in refusal.text

    fly(story, config())


@pytest.mark.soak
def test_a_transponder_that_fails_in_flight_is_an_alarm() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.wait(3.0)
        await show.start()
        assert in_alarm(show) == {}
        show.befall("d3", "transponder", how="lost")
        await show.wait(6.0)
        assert set(in_alarm(show)) == {"d3"}
        assert "silent" in in_alarm(show)["d3"]
        show.befall("d3", "transponder", how="lost-operator")
        await show.wait(6.0)
        assert "SYS OP_LOC" in in_alarm(show)["d3"]

    fly(story, config(), transponders=True, parameters=REQUIRED)


@pytest.mark.soak
def test_ardupilot_refuses_by_itself_and_reports_the_loss() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.wait(5.0)
        commander = cast("Commander", show.fleet.autopilots[0].commander)
        assert commander.reasons() == []
        show.befall("d1", "transponder", how="lost")
        await show.wait(9.0)
        assert commander.reasons() == ["OpenDroneID: ARM_STATUS not available"]
        texts = [each.text for each in show.service.preflight.flight.newest.telemetry.texts[0]]
        assert "ODID: lost transmitter" in texts

    fly(story, by_ardupilot(), transponders=True, parameters=ENFORCED, version="4.5")


@pytest.mark.soak
@pytest.mark.parametrize(
    ("name", "value", "problem"),
    [
        ("DID_ENABLE", 0, "DID_ENABLE is 0, 1 is needed"),
        ("DID_OPTIONS", 2, "DID_OPTIONS is 2, 1 or 3 or 5 or 7 is needed"),
    ],
)
def test_an_ardupilot_that_would_arm_without_one_is_refused(name: str, value: int, problem: str) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.wait(3.0)
        refusal = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
        assert f"d1, d2: {problem}" in refusal.text
        show.befall("d1", "transponder", how="lost")
        await show.wait(9.0)
        assert cast("Commander", show.fleet.autopilots[0].commander).reasons() == []

    fly(story, by_ardupilot(), transponders=True, parameters=ENFORCED | {name: value}, version="4.5")


@pytest.mark.soak
def test_an_operator_whose_receiver_is_silent_is_unknown() -> None:
    source = {"kind": "gpsd", "at": "tcp://127.0.0.1:2947"}

    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.wait(3.0)
        assert "" in in_alarm(show, AlarmCause.OPERATOR_UNKNOWN)
        refusal = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
        assert "it is not known where the operator is" in refusal.text

    fly(story, config(operator=None, source=source, require=False))
