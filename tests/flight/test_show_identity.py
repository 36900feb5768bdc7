"""Identity of a vehicle: its port changes in flight, other components use its id, its autopilot is absent."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.flight.state.vehicle import LANDED_UNKNOWN, NOT_RECEIVED
from gcs.links.address_book import BOTH_S
from gcs.model.lifecycle import Phase
from gcs.model.preflight_report import State
from gcs.service.alarms import AlarmCause
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from tests.flight.test_show_autopilots import config_of

ELSEWHERE, ITS_PORT = "10.0.9.9", 14550
COMPANION, GIMBAL, RADIO = 191, 154, 68
CHANGES, CHANGE_S = 20, 1.5


class Seen(NamedTuple):
    phases: set[Phase]
    alarms: set[AlarmCause]
    oldest_s: float  # age of the oldest position in any tick
    violations: int


def seen(show: VirtualShow, begin_s: float) -> Seen:
    track = show.track.between(begin_s)
    ages_s = [view.position_age_s for name in show.config.ids for view in track.of(name)]
    alarms = {alarm.cause for sample in track.samples for alarm in sample.view.alarms}
    phases = {phase for name in show.config.ids for phase in track.phases(name)}
    return Seen(phases, alarms, max(age_s for age_s in ages_s if age_s is not None), show.floor_violations())


@pytest.mark.soak
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("fault", [{}, {"loss": 0.1}], ids=["sound", "lossy"])
def test_a_port_that_changes_in_flight_ends_no_flight(autopilot: str, fault: dict[str, float]) -> None:
    async def story(show: VirtualShow) -> Seen:
        await show.start()
        begin_s = show.now_s
        for name, share in fault.items():
            for vehicle_id in show.config.ids:
                show.befall(vehicle_id, name, share=share)
        for number in range(CHANGES):
            show.ports.change_port(show.config.ids[number % len(show.config.ids)])
            await show.wait(CHANGE_S)
        return seen(show, begin_s)

    found = fly(story, config_of((autopilot, autopilot)))
    assert found.phases == {Phase.FORMATION}
    assert AlarmCause.DUPLICATE_SYSTEM_ID not in found.alarms
    assert found.oldest_s < 0.6
    assert found.violations == 0


@pytest.mark.soak
def test_a_router_that_restarts_changes_all_ports_at_once() -> None:
    async def story(show: VirtualShow) -> Seen:
        await show.start()
        begin_s = show.now_s
        for _ in range(5):
            show.ports.silence(*show.config.ids)
            await show.wait(0.5)
            for name in show.config.ids:
                show.ports.change_port(name)
            show.ports.restore(*show.config.ids)
            await show.wait(2.0)
        return seen(show, begin_s)

    found = fly(story, show_config(4))
    assert found.phases == {Phase.FORMATION}
    assert AlarmCause.DUPLICATE_SYSTEM_ID not in found.alarms
    assert found.oldest_s < 1.1
    assert found.violations == 0


class Part:
    """A component that sends in the name of a system, ten times a second, from an address of its own."""

    def __init__(self, show: VirtualShow, system_id: int, component: int) -> None:
        self.show, self.port = show, ITS_PORT + system_id
        self.packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=component)

    def send(self, *messages: Any) -> None:
        raw = b"".join(bytes(message.pack(self.packer)) for message in messages)
        self.show.ports.arrive_from(ELSEWHERE, self.port, raw)

    async def live(self, *messages: Any) -> None:
        while True:
            self.send(*messages)
            await asyncio.sleep(0.1)


@contextmanager
def beside(*lives: Any) -> Iterator[None]:
    tasks = [asyncio.create_task(each) for each in lives]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()


def lies() -> list[Any]:
    """What would end a flight if it were believed."""
    far_off = (0, 480000000, 90000000, 0, 0, 0, 0, 0, 0)
    return [
        dialect.MAVLink_heartbeat_message(18, 12, 0x81, 4 << 16 | 6 << 24, 6, 3),
        dialect.MAVLink_global_position_int_message(*far_off),
        dialect.MAVLink_battery_status_message(0, 0, 0, 0, [3000] * 10, -1, -1, -1, 2),
        dialect.MAVLink_extended_sys_state_message(0, 1),
        dialect.MAVLink_radio_status_message(1, 1, 100, 50, 50, 0, 0),
    ]


@pytest.mark.soak
def test_components_received_first_change_no_vehicle() -> None:
    async def story(show: VirtualShow) -> Seen:
        parts = [Part(show, number, kind) for number in range(1, 5) for kind in (COMPANION, GIMBAL, RADIO)]
        with beside(*(part.live(*lies()) for part in parts)):
            await show.start()
            begin_s = show.now_s
            await show.wait(20.0)
            return seen(show, begin_s)

    found = fly(story, show_config(4))
    assert found.phases == {Phase.FORMATION}
    assert AlarmCause.DUPLICATE_SYSTEM_ID not in found.alarms
    assert found.violations == 0


@pytest.mark.soak
@pytest.mark.parametrize(
    ("component", "autopilot", "to_do"),
    [
        (50, 12, "set MAV_COMP_ID to 1, and restart its autopilot"),
        (COMPANION, 8, "look after the autopilot itself, which is component 1"),
    ],
)
def test_vehicle_without_its_autopilot_is_named(component: int, autopilot: int, to_do: str) -> None:
    async def story(show: VirtualShow) -> None:
        show.ports.silence("d3")
        heartbeat = dialect.MAVLink_heartbeat_message(2, autopilot, 0x01, 4 << 16 | 3 << 24, 4, 3)
        with beside(Part(show, 3, component).live(heartbeat)):
            await show.standby()
            problem = f"system 3 is received from component {component} only"
            assert (show.vehicle("d3").phase, show.vehicle("d3").reason) == (
                Phase.OFFLINE,
                f"{problem}: {to_do}",
            )
            report = show.service.preflight.report()
            (check,) = [
                check
                for vehicle in report.vehicles
                if vehicle.id == "d3"
                for check in vehicle.failed
                if check.name == "autopilot"
            ]
            assert (check.state, check.problem, check.to_do) == (State.FAIL, problem, to_do)
        await show.wait(4.0)
        assert show.vehicle("d3").reason == NOT_RECEIVED
        show.ports.restore("d3")
        await show.phase("d3", Phase.STANDBY)

    fly(story, show_config(4))


@pytest.mark.soak
def test_vehicle_whose_landed_state_is_not_known_says_it() -> None:
    async def story(show: VirtualShow) -> None:
        show.ports.silence("d3")
        heartbeat = dialect.MAVLink_heartbeat_message(2, 12, 0x01, 4 << 16 | 3 << 24, 4, 3)
        place = (0, 473977420, 85455940, 488000, 0, 0, 0, 0, 0)
        position = dialect.MAVLink_global_position_int_message(*place)
        with beside(Part(show, 3, 1).live(heartbeat, position)):
            await show.standby()
            await show.wait(2.0 * BOTH_S)
            assert (show.vehicle("d3").phase, show.vehicle("d3").reason) == (Phase.OFFLINE, LANDED_UNKNOWN)

    fly(story, show_config(4))
