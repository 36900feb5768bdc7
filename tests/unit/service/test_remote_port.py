"""Both ends of the service port over a real pair of sockets, as two processes have them."""

import asyncio
import logging
import socket
import time
from collections.abc import Coroutine
from pathlib import Path
from threading import Timer
from typing import Any, TypeVar

import pytest

from gcs.model.errors import GcsError, InvalidError, LinkError, Problem, RefusedError, ShowError, UnknownError
from gcs.model.interrupted_flight import Offer
from gcs.model.plan import Direction, Formation, Obstacle, Orbit, Target, Yaw, YawPolicy
from gcs.model.target_fix import TargetFix
from gcs.service import CALLER, Call, FleetView, ShowAction, VehicleAction, WeatherEntry
from gcs.service.remote import RemoteService
from gcs.service.remote.messages import METHODS, REQUEST_MAX_BYTES, framed
from tests.support.api_fake_service import FakeService
from tests.support.remote_port import Control, remote

T = TypeVar("T")

BOX = Obstacle("tower", 1.0, -2.5, 3.0, 4.0, 5.0, 0.5, -0.25, 77.125)

FIX = TargetFix(12345.5, 47.3977, 8.5456, 488.0, 1.25, -0.5, 0.0, 1.0, 2.0, 0.1, 1.8e9, "A1", "manned", 500.0)

CALLS: dict[str, dict[str, Any]] = {
    "audit.call": {"call": Call("crew", "POST", "/api/v1/show/start", '{"a": "ä\u2028"}', 202)},
    "audit.kept": {},
    "plan.current": {},
    "plan.set_formation": {"formation": Formation(10.5, 20.0, -0.125, "article")},
    "plan.set_orbit": {"orbit": Orbit(3.0, 1.5, Direction.CLOCKWISE)},
    "plan.set_target": {"target": Target(1.0, 2.0, 0.1, 0.2, 12345.678901234567)},
    "plan.select_target": {"name": "boat"},
    "plan.hold_target": {},
    "plan.report_target": {"name": "boat", "fix": FIX},
    "plan.set_yaw": {"yaw": Yaw(YawPolicy.FIXED, 1.25)},
    "plan.add_obstacle": {"obstacle": BOX},
    "plan.change_obstacle": {"obstacle": BOX},
    "plan.remove_obstacle": {"obstacle_id": "tower"},
    "commands.command_show": {
        "action": ShowAction.START,
        "vehicles": ["d1", "d2"],
        "show_hash": None,
        "at_unix_time_s": 1.8e9 + 1e-6,
    },
    "commands.command_vehicle": {"vehicle_id": "d1", "action": VehicleAction.TAKE_CONTROL},
    "commands.command_vehicles": {"action": VehicleAction.HOLD, "vehicles": None},
    "commands.kill": {"vehicle_ids": ["d1"]},
    "stations.take_lead": {},
    "stations.take_over": {"station": "south"},
    "command_log.get": {"command_id": "o1"},
    "command_log.newest": {},
    "recovery.settle": {"offer": Offer.BRING_HOME},
    "site.read": {},
    "site.text": {"form": "kml"},
    "site.change": {"text": b"\xff\x00 no text" * 6000, "version": "f" * 64},
    "shows.why_not_kept": {},
    "shows.rules": {},
    "shows.list_shows": {},
    "shows.text": {"name": "a"},
    "shows.store": {"name": "a", "text": b"\xff\x00 no text" * 6000},
    "shows.store_drawn": {"name": "a", "text": b"about: x", "drawing": Path("a.skyc")},
    "shows.drawn_file": {"name": "a"},
    "shows.remove": {"name": "a"},
    "shows.check": {"name": "a"},
    "shows.checked": {"name": "a"},
    "player.select": {"name": "a", "show_hash": "f" * 64},
    "player.deselect": {},
    "player.seek": {"cue": "climb"},
    "player.begin_at": {"at_unix_time_s": 1.8e9 + 1e-6},
    "player.cancel_begin": {},
    "player.follow_external_clock": {"follow": False},
    "preflight.report": {"vehicles": [f"vehicle-{row}" for row in range(2000)]},
    "preflight.exclude": {"vehicle_id": "d1", "reason": "bent"},
    "preflight.include": {"vehicle_id": "d1"},
    "commands.confirm_start": {"go_hash": "3f2a9c01b4de"},
    "go.sign": {"role": "pads", "items": [1, 2]},
    "go.reopen": {"role": "pads", "items": [2]},
    "go.enter_weather": {"entry": WeatherEntry(wind_m_s=4.5, kp=2.0)},
    "alarms.acknowledge": {"alarm_id": "battery:d1"},
    "alarms.acknowledge_all": {},
    "events.newest": {},
    "events.marks": {},
}
"""Arguments for every method and property of the port."""


class SpyRole:
    """Notes every call, and returns its number."""

    def __init__(self, role: str, calls: list[tuple[str, dict[str, Any], str]]) -> None:
        self._role, self._calls = role, calls

    def __getattr__(self, name: str) -> Any:
        method = METHODS[f"{self._role}.{name}"]

        def note(*given: Any, **named: Any) -> int:
            arguments = method.signature.bind(*given, **named).arguments
            self._calls.append((f"{self._role}.{name}", dict(arguments), CALLER.get()))
            return len(self._calls)

        async def note_later(*given: Any, **named: Any) -> int:
            await asyncio.sleep(0)
            return note(*given, **named)

        return note() if method.is_property else note_later if method.is_async else note


class Spy(FakeService):
    """A service of spies, apart from its view."""

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[tuple[str, dict[str, Any], str]] = []
        for role in {name.split(".")[0] for name in CALLS}:
            setattr(self, role, SpyRole(role, self.calls))


def answered(port: RemoteService, what: Coroutine[Any, Any, T]) -> T:
    """Run it on an event loop that receives control's messages."""

    async def both() -> T:
        receiving = asyncio.create_task(port.run())
        try:
            return await what
        finally:
            receiving.cancel()

    return asyncio.run(both())


def test_every_method_of_the_port_has_arguments_here() -> None:
    assert {name for name in METHODS if name.split(".")[0] not in {"view", "api"}} == CALLS.keys()


@pytest.mark.parametrize("name", sorted(CALLS.keys() - {"audit.call", "shows.why_not_kept", "audit.kept"}))
def test_every_call_reaches_control_as_it_was_made(name: str) -> None:
    spy, (role, member) = Spy(), name.split(".")
    token = CALLER.set("crew")
    try:
        with remote(spy) as (port, _control):
            spy.calls.clear()
            asked = getattr(getattr(port, role), member)
            method = METHODS[name]
            if method.is_property:
                result = asked
            elif method.is_async:
                result = answered(port, asked(**CALLS[name]))
            else:
                result = asked(**CALLS[name])
    finally:
        CALLER.reset(token)
    assert spy.calls == [(name, CALLS[name], "crew")]
    assert result == 1


def test_audit_is_kept_elsewhere_and_its_calls_do_not_wait() -> None:
    spy = Spy()
    with remote(spy) as (port, control):
        spy.calls.clear()
        with control.hanging():
            began_s = time.monotonic()
            port.audit.call(CALLS["audit.call"]["call"])
            assert time.monotonic() - began_s < 1.0
        assert answered(port, port.audit.kept())
    assert [name for name, _, _ in spy.calls] == ["audit.call", "audit.kept"]


@pytest.mark.parametrize(
    "error",
    [
        InvalidError("radius_m", 3.5, "at least 5 m"),
        RefusedError("not now"),
        UnknownError("there is no d9"),
        ShowError("a.yaml", [Problem(3, "climb", "too high")] * 150),
    ],
)
def test_errors_of_control_come_back_as_they_were_raised(error: GcsError) -> None:
    service = FakeService()

    def refuse(_orbit: Orbit) -> None:
        raise error

    vars(service.plan)["set_orbit"] = refuse
    with remote(service) as (port, _control), pytest.raises(type(error)) as raised:
        port.plan.set_orbit(Orbit())
    assert str(raised.value) == str(error)
    assert vars(raised.value) == vars(error)


def test_bug_in_control_fails_one_call_only(caplog: pytest.LogCaptureFixture) -> None:
    service = FakeService()

    def fail(_orbit: Orbit) -> None:
        raise ZeroDivisionError

    vars(service.plan)["set_orbit"] = fail
    with caplog.at_level(logging.ERROR, "gcs.service"), remote(service) as (port, _control):
        with pytest.raises(GcsError, match="set_orbit failed"):
            port.plan.set_orbit(Orbit())
        assert port.plan.current.orbit == Orbit()
    assert "ZeroDivisionError" in caplog.text


def test_view_is_asked_for_once_a_tick_and_only_if_it_is_read() -> None:
    service = FakeService(count=3)
    service.fly()
    looks: list[int] = []

    def tick() -> None:
        service.tick()
        view = service.view.value

        def look() -> FleetView:
            looks.append(service.ticks)
            return view

        service.view.promise(look)

    async def read(port: RemoteService, control: Control) -> None:
        for _ in range(3):
            changed = asyncio.create_task(port.view.changed())
            await asyncio.sleep(0)
            control.do(tick)
            await changed
        assert looks == []
        view = port.view.value
        assert port.view.value is view
        assert looks == [service.ticks] == [view.tick.count]
        theirs = service.view.value
        assert view.time_s == theirs.time_s
        assert view.rows.position_m.tolist() == theirs.rows.position_m.tolist()
        assert not view.rows.position_m.flags.writeable
        homes_m = [None if home_m is None else home_m.tolist() for home_m in view.rows.homes_m]
        assert homes_m == [None if home_m is None else home_m.tolist() for home_m in theirs.rows.homes_m]
        assert [each.collect() for each in view.histograms] == [
            tuple(each.collect()) for each in theirs.histograms
        ]

    with remote(service) as (port, control):
        answered(port, read(port, control))


def test_call_without_an_answer_fails_and_is_not_made_later() -> None:
    service = FakeService()
    with remote(service, answer_s=0.3) as (port, control):
        before = port.view.value
        with control.hanging():
            with pytest.raises(LinkError, match="control does not answer"):
                port.plan.set_orbit(Orbit(5.0))
            with pytest.raises(LinkError, match="control does not answer"):
                port.plan.set_orbit(Orbit(6.0))
            began_s = time.monotonic()
            assert port.view.value is before
            assert port.events.newest() == ()
            assert time.monotonic() - began_s < 0.2, "displays do not wait"
        Timer(0.1, control.do, (service.tick,)).start()
        assert port.plan.current.orbit == Orbit(), "a call that comes when control goes on is answered"
        port.plan.set_orbit(Orbit(7.0))
        assert port.view.value.plan.orbit == Orbit()
        control.do(service.tick)
        assert port.plan.current.orbit == Orbit(7.0)
        assert port.view.value.plan.orbit == Orbit(7.0)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (framed(b"junk\n{}"), "no request"),
        (framed(b'{"id":1,"method":"plan.__class__","caller":"x","deadline_s":9e9}\n{}'), "there is no"),
        (framed(b'{"id":1,"method":"view.promise","caller":"x","deadline_s":9e9}\n{}'), "there is no"),
        (framed(b'{"id":"1","method":"plan.current","caller":"x","deadline_s":9e9}\n{}'), "no request"),
        ((REQUEST_MAX_BYTES + 1).to_bytes(4), "at most"),
    ],
)
def test_message_that_is_no_request_ends_the_line(message: bytes, reason: str) -> None:
    ours, theirs = socket.socketpair()
    with theirs, Control(FakeService(), ours) as control:
        theirs.sendall(message)
        with pytest.raises(LinkError, match=reason):
            control.ended.result(30)


@pytest.mark.parametrize(
    "arguments",
    [b"{}", b'{"orbit": 3}', b'{"orbit": {"radius_m": "1"}}', b'{"orbit": {"radius_m": -1.0}}', b"[", b""],
)
def test_arguments_of_another_type_are_refused(arguments: bytes) -> None:
    service = FakeService()
    with remote(service) as (port, _control):
        method = METHODS["plan.set_orbit"]
        with pytest.raises(InvalidError):
            method.unpacked(arguments)
        assert port.plan.current.orbit == Orbit()


def test_flood_of_requests_lets_control_go_on() -> None:
    service = FakeService()
    head = b'{"id":1,"method":"command_log.newest","caller":"x","deadline_s":9e9}\n{}'
    ours, theirs = socket.socketpair()
    with theirs, Control(service, ours) as control:
        theirs.setblocking(False)
        for _ in range(50):
            try:
                while True:
                    theirs.send(framed(head) * 50)
            except BlockingIOError:
                began_s = time.monotonic()
                control.do(service.tick)
                assert time.monotonic() - began_s < 2.0


def test_client_that_reads_nothing_costs_control_nothing() -> None:
    service = FakeService()
    ours, theirs = socket.socketpair()
    with theirs, Control(service, ours) as control:
        for _ in range(3000):
            control.do(service.tick)
        theirs.setblocking(False)
        received = 0
        for _ in range(100):
            try:
                received += len(theirs.recv(1 << 20))
            except BlockingIOError:
                break
        assert received < 3000 * 4, "some were left out"


def test_each_end_notices_that_the_other_one_has_closed() -> None:
    ours, theirs = socket.socketpair()
    with Control(FakeService(), ours) as control:
        port = RemoteService(theirs)
        theirs.close()
        control.ended.result(30)
    with remote(FakeService()) as (port, control):

        async def until_closed() -> None:
            receiving = asyncio.create_task(port.run())
            await asyncio.sleep(0.05)
            control.end()
            await asyncio.wait_for(receiving, 30)

        asyncio.run(until_closed())
        with pytest.raises(LinkError, match="control has ended"):
            port.plan.set_orbit(Orbit())


def test_client_without_control_does_not_wait_for_it() -> None:
    ours, theirs = socket.socketpair()
    with theirs:
        ours.close()
        with pytest.raises(LinkError, match="control has ended"):
            RemoteService(theirs)


def test_signs_of_life_arrive() -> None:
    with remote(FakeService()) as (port, control):
        port.listens()
        answered(port, asyncio.sleep(0.1))
        control.do(lambda: None)
        assert control.reports.listening
        assert control.reports.beats == 1
