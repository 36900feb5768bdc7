"""Shows of ArduCopters, alone and beside PX4 in one fleet: the same phases, each by its own commands."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.links import Verb
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Orbit
from gcs.model.preflight_report import State
from gcs.model.state import Mode
from gcs.service import Outcome, ShowAction, VehicleAction
from gcs.service.alarms import AlarmCause
from gcs.testing.virtual_show import RefusedCall, VirtualShow, fly, refused, show_config

COUNT, LOITER = 4, 5
PX4, ARDUPILOT = "px4", "ardupilot"
FLEETS = pytest.mark.parametrize("kinds", [(ARDUPILOT, ARDUPILOT), (PX4, ARDUPILOT)], ids=["alone", "mixed"])


def config_of(kinds: tuple[str, str], count: int = COUNT, **operation: Any) -> Config:
    """Vehicles with these autopilots in turn; all fly on equally long without setpoints, and hold then."""
    settings = {"setpoint_loss_s": 3.0, "setpoint_loss_action": "hold", **operation}
    raw = show_config(count, operation=settings).model_dump()
    vehicles = [each.model_dump() for each in show_config(count).fleet]
    raw["links"][0]["transport"] = "native"  # which decides the system id of the station
    raw["links"][0]["vehicles"] = [
        vehicle | {"autopilot": kinds[row % 2]} for row, vehicle in enumerate(vehicles)
    ]
    return Config.model_validate(raw)


async def start(show: VirtualShow) -> RefusedCall:
    return await refused(show, lambda: show.service.commands.command_show(ShowAction.START))


class WholeShow(NamedTuple):
    violations: int
    verbs: dict[str, list[Verb]]
    up_s: list[float]  # when each was commanded to hold above its pad
    first_setpoint_s: list[float]
    outcome: Outcome


@pytest.mark.soak
@FLEETS
def test_show_of_any_autopilots_keeps_the_floor_and_lands(kinds: tuple[str, str]) -> None:
    async def story(show: VirtualShow) -> WholeShow:
        await show.start()
        show.service.plan.set_orbit(Orbit(radius_m=5.0, speed_m_s=2.0))
        await show.wait(15.0)
        stopped = await show.show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED)
        given = show.ports.commands
        off_s = [next(one.time_s for one in each if one.verb is Verb.TAKEOFF) for each in given.values()]
        up_s = [
            next(one.time_s for one in each if one.verb is Verb.HOLD and one.time_s > after_s)
            for each, after_s in zip(given.values(), off_s, strict=True)
        ]
        return WholeShow(
            show.floor_violations(),
            {name: [one.verb for one in each] for name, each in given.items()},
            up_s,
            [sent[0].time_s for sent in show.ports.sent.values()],
            stopped.outcome,
        )

    flown = fly(story, config_of(kinds))
    assert (flown.violations, flown.outcome) == (0, Outcome.DONE)
    for verbs in flown.verbs.values():
        order = [verb for verb in verbs if verb in {Verb.ARM, Verb.TAKEOFF, Verb.LAND}]
        assert order == [Verb.ARM, Verb.TAKEOFF, Verb.LAND]
    assert (np.array(flown.first_setpoint_s) > np.array(flown.up_s)).all(), "none before it is up"


@pytest.mark.soak
def test_each_autopilot_is_named_in_state_and_preflight() -> None:
    async def story(show: VirtualShow) -> tuple[list[str], list[str]]:
        await show.standby()
        checked = show.service.preflight.report().vehicles
        return list(show.service.view.value.rows.autopilots), [each.autopilot for each in checked]

    kinds = [PX4, ARDUPILOT]
    assert fly(story, config_of((PX4, ARDUPILOT), 2)) == (kinds, kinds)


@pytest.mark.soak
@FLEETS
def test_second_show_flies_after_the_first(kinds: tuple[str, str]) -> None:
    """After a landing ArduCopter stays in LAND, in which it cannot be armed."""

    async def story(show: VirtualShow) -> tuple[list[Mode], int]:
        await show.start()
        await show.show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED)
        await show.wait(9.0)
        modes = [show.vehicle(name).mode for name in show.config.ids]
        await show.start()
        return modes, show.floor_violations()

    modes, violations = fly(story, config_of(kinds))
    assert violations == 0
    assert modes == [Mode.HOLD if kinds[row % 2] == PX4 else Mode.OFFBOARD for row in range(COUNT)]


@pytest.mark.soak
@FLEETS
def test_vehicle_that_loses_its_link_is_kept_clear_of(kinds: tuple[str, str]) -> None:
    async def story(show: VirtualShow) -> tuple[Phase, Phase, int]:
        await show.start()
        show.service.plan.set_orbit(Orbit(radius_m=5.0, speed_m_s=2.0))
        await show.wait(8.0)
        show.ports.silence("d2")
        await show.wait(15.0)
        lost = show.vehicle("d2").phase
        show.ports.restore("d2")
        await show.wait(15.0)
        again = show.vehicle("d2").phase
        return lost, again, show.floor_violations()

    lost, again, violations = fly(story, config_of(kinds))
    assert (lost, again, violations) == (Phase.LOST, Phase.FORMATION, 0)


@pytest.mark.soak
@FLEETS
def test_pilot_takes_an_ardupilot_vehicle_and_gives_it_back(kinds: tuple[str, str]) -> None:
    async def story(show: VirtualShow) -> tuple[Phase, str, int, Outcome]:
        await show.start()
        show.service.plan.set_orbit(Orbit(radius_m=5.0, speed_m_s=2.0))
        fake: Any = show.fleet.autopilots[1]
        fake.commander.change_mode(LOITER)
        await show.wait(1.5)
        taken = show.vehicle("d2")
        before = len(show.ports.sent["d2"])
        await show.wait(1.0)
        sent = len(show.ports.sent["d2"]) - before
        back = await show.command("d2", VehicleAction.TAKE_CONTROL)
        return taken.phase, taken.reason, sent, back.outcome

    phase, reason, sent, outcome = fly(story, config_of(kinds))
    assert (phase, sent, outcome) == (Phase.PILOT, 0, Outcome.DONE)
    assert "did not command" in reason


@pytest.mark.soak
@pytest.mark.parametrize(
    ("action", "mode", "does"),
    [(4, Mode.HOLD, "holds"), (1, Mode.RETURN, "returns"), (2, Mode.LAND, "lands")],
)
def test_breach_of_its_own_fence_is_named_and_left_alone(action: int, mode: Mode, does: str) -> None:
    """No text says so, and its state is not that of a failsafe: by the health of its fence."""

    async def story(show: VirtualShow) -> tuple[Phase, Mode, str, set[AlarmCause], int, Phase]:
        await show.start()
        await show.wait(2.0)
        fake: Any = show.fleet.autopilots[1]
        fake.parameters.set("FENCE_ACTION", action)
        fake.parameters.set("FENCE_ALT_MAX", 3.0)
        await show.wait(2.5)
        before = len(show.ports.sent["d2"])
        await show.wait(1.5)
        seen = show.vehicle("d2")
        alarms = {alarm.cause for alarm in show.service.view.value.alarms if "d2" in alarm.vehicles}
        sent = len(show.ports.sent["d2"]) - before
        return seen.phase, seen.mode, seen.reason, alarms, sent, show.vehicle("d1").phase

    phase, now, reason, alarms, sent, other = fly(story, config_of((PX4, ARDUPILOT)))
    assert (phase, now, sent, other) == (Phase.PILOT, mode, 0, Phase.FORMATION)
    assert reason.startswith(f"d2 {does} by its own geofence failsafe")
    assert AlarmCause.OWN_FAILSAFE in alarms


def test_ardupilot_as_delivered_is_refused() -> None:
    async def story(show: VirtualShow) -> RefusedCall:
        await show.standby()
        return await start(show)

    delivered = {"SYSID_MYGCS": 255, "WPNAV_ACCEL": 100.0, "FENCE_ENABLE": 0}
    text = fly(story, config_of((ARDUPILOT, ARDUPILOT), 2), parameters=delivered).text
    for name in delivered:
        assert f"{name} is" in text


def test_what_a_version_lacks_is_named_before_a_start() -> None:
    async def story(show: VirtualShow) -> tuple[str, ...]:
        await show.standby()
        return show.service.preflight.report().not_checked

    (risk,) = [text for text in fly(story, config_of((PX4, ARDUPILOT))) if "GUID_TIMEOUT" in text]
    assert risk.startswith("d2, d4: no GUID_TIMEOUT: it flies on for 3 s after its last setpoint")


@pytest.mark.soak
def test_fleet_with_different_loss_times_is_refused() -> None:
    """The recorded ArduCopter has no GUID_TIMEOUT, and flies on for 3 s, whatever is configured."""

    async def checked(show: VirtualShow) -> list[tuple[str, State]]:
        await show.standby()
        return [(check.name, check.state) for check in show.service.preflight.report().fleet]

    async def story(show: VirtualShow) -> tuple[str, list[tuple[str, State]]]:
        checks = await checked(show)
        return (await start(show)).text, checks

    def config(loss_s: float) -> Config:
        return config_of((PX4, ARDUPILOT), setpoint_loss_s=loss_s, require_safe_setpoint_loss=True)

    text, checks = fly(story, config(1.0))
    assert "d2, d4 for 3 s, d1, d3 for 1 s fly on" in text
    assert ("loss times", State.FAIL) in checks
    text, checks = fly(story, config(3.0), parameters={"COM_OF_LOSS_T": 1.0})
    assert "COM_OF_LOSS_T is 1, 3 s is needed" in text
    assert ("loss times", State.FAIL) in checks, "by the parameter as read, not as configured"
    assert ("loss times", State.PASS) in fly(checked, config(3.0))


@pytest.mark.soak
@FLEETS
def test_stalled_service_finds_every_vehicle_and_lands_all(kinds: tuple[str, str]) -> None:
    """For 5 s nothing is sent: PX4 holds by itself, ArduCopter hovers in GUIDED."""

    async def story(show: VirtualShow) -> tuple[int, Outcome]:
        await show.start()
        show.service.plan.set_orbit(Orbit(radius_m=5.0, speed_m_s=2.0))
        await show.wait(5.0)
        show.link.takes_s = 5.0
        await show.wait(0.2)
        show.link.takes_s = 0.0
        await show.wait(6.0)
        stopped = await show.show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED)
        return show.floor_violations(), stopped.outcome

    assert fly(story, config_of(kinds)) == (0, Outcome.DONE)


@pytest.mark.keeps("mixed")
@FLEETS
def test_all_vehicles_that_lose_the_station_at_once_stay_apart(kinds: tuple[str, str]) -> None:
    """Neither setpoints nor heartbeats reach them: each does what its own autopilot does."""

    async def story(show: VirtualShow) -> tuple[int, float, set[Mode]]:
        await show.start()
        show.service.plan.set_orbit(Orbit(radius_m=5.0, speed_m_s=2.0))
        await show.wait(8.0)
        show.ports.silence(*show.config.ids)
        await show.wait(10.0)
        before_m = show.true_m
        await show.wait(5.0)
        moved_m = float(np.linalg.norm(show.true_m - before_m, axis=1).max())
        show.ports.restore(*show.config.ids)
        await show.wait(1.5)
        return show.floor_violations(), moved_m, {show.vehicle(name).mode for name in show.config.ids}

    violations, moved_m, modes = fly(story, config_of(kinds))
    assert violations == 0
    assert moved_m < 2.0, "they hover"
    assert modes <= {Mode.HOLD, Mode.OFFBOARD}


@pytest.mark.soak
def test_lost_station_brings_ardupilot_home() -> None:
    """By its heartbeat failsafe, which is named when the link is back."""

    async def story(show: VirtualShow) -> tuple[list[Mode], str, int]:
        await show.start()
        await show.wait(3.0)
        show.ports.silence(*show.config.ids)
        await show.wait(12.0)
        show.ports.restore(*show.config.ids)
        await show.wait(2.0)
        seen = show.vehicle("d1")
        return [show.vehicle(name).mode for name in show.config.ids], seen.reason, show.floor_violations()

    modes, reason, _ = fly(story, config_of((ARDUPILOT, ARDUPILOT), 2, setpoint_loss_action="return"))
    assert modes == [Mode.RETURN] * 2
    assert "data-link-loss" in reason


@pytest.mark.soak
def test_killed_ardupilot_closes_the_air_below_it_until_it_lies() -> None:
    async def story(show: VirtualShow) -> list[tuple[str, float]]:
        await show.start()
        record = show.service.commands.kill(["d1"])
        seen = []
        for _ in range(12):
            await show.wait(0.25)
            where = show.service.view.value.rows.landed[0]
            seen.append((where.name, float(-show.true_m[0, 2])))
        assert show.service.command_log.get(record.id).outcome is Outcome.DONE
        return seen

    seen = fly(story, config_of((ARDUPILOT, ARDUPILOT), 2))
    assert not any(name == "ON_GROUND" and height_m > 3.5 for name, height_m in seen)
    assert seen[-1][0] == "ON_GROUND"


@pytest.mark.soak
def test_acceleration_as_read_is_what_the_filter_counts_on() -> None:
    async def story(show: VirtualShow) -> list[float]:
        await show.start()
        return [float(each) for each in show.service.player.newest.traits.response.acceleration_m_s2]

    set_to = {"WPNAV_ACCEL": 400.0, "PILOT_ACCEL_Z": 300, "WPNAV_ACCEL_Z": 350.0}  # 4.0 or 4.1: either counts
    assert fly(story, config_of((PX4, ARDUPILOT), 2), parameters=set_to) == [np.inf, pytest.approx(2.4)]


@pytest.mark.soak
def test_vehicle_slower_than_its_parameters_said_is_named() -> None:
    """Its WPNAV_ACCEL falls after the check, as a script on board may have it."""

    async def story(show: VirtualShow) -> tuple[str, tuple[str, ...], int]:
        await show.start()
        part: Any
        part, row = show.fleet.part_of(1)
        part.state.limit_m_s2[row] = 0.6
        for _ in range(4):
            show.service.plan.set_orbit(Orbit(radius_m=25.0, speed_m_s=4.0))
            await show.wait(8.0)
            show.service.plan.set_orbit(Orbit(radius_m=0.0))
            await show.wait(8.0)
        alarm = next(one for one in show.view.alarms if one.cause is AlarmCause.SLOW_ANSWERS)
        return alarm.text, alarm.vehicles, show.floor_violations()

    text, vehicles, violations = fly(story, config_of((PX4, ARDUPILOT)))
    assert vehicles == ("d2",)
    assert "ArduPilot, less than 1.4 m/s^2" in text
    assert violations == 0
