"""A kill takes two steps: a code that names whom, and the code given back in time, by the same caller."""

from collections.abc import Sequence

import pytest

from gcs.api.auth.authorization import VALID_S, WAITING_MAX, KillSwitch
from gcs.model.errors import LinkError, RefusedError
from gcs.model.lifecycle import Phase
from gcs.service import CommandRecord, Outcome, VehicleOutcome
from tests.support.api_harness import Api


@pytest.fixture
def api() -> Api:
    return Api()


def test_kill_needs_its_code_and_reaches_only_those_named(api: Api) -> None:
    api.service.fly()
    armed = api("POST", "/api/v1/kill", json={"vehicles": ["d2", "d2"]})
    assert (armed.status_code, armed.json()["vehicles"], armed.json()["valid_s"]) == (200, ["d2"], VALID_S)
    assert set(api.service.phases.values()) == {Phase.FORMATION}
    answer = api("POST", "/api/v1/kill/confirm", json={"code": armed.json()["code"]})
    assert answer.status_code == 202
    assert answer.headers["location"] == f"/api/v1/commands/{answer.json()['id']}"
    assert set(answer.json()["outcomes"]) == {"d2"}
    assert api.service.phases == {"d1": Phase.FORMATION, "d2": Phase.KILLED, "d3": Phase.FORMATION}
    again = api("POST", "/api/v1/kill/confirm", json={"code": armed.json()["code"]})
    assert (again.status_code, "a code works once" in again.json()["detail"]) == (409, True)


def test_kill_without_names_means_all_that_are_not_offline(api: Api) -> None:
    api.service.fly()
    api.service.phases["d3"] = Phase.OFFLINE
    api.service.tick()
    assert api("POST", "/api/v1/kill").json()["vehicles"] == ["d1", "d2"]
    api.service.phases = dict.fromkeys(api.service.phases, Phase.OFFLINE)
    api.service.tick()
    empty = api("POST", "/api/v1/kill")
    assert (empty.status_code, "--direct" in empty.json()["detail"]) == (409, True)


def test_unknown_or_offline_vehicles_are_named(api: Api) -> None:
    api.service.phases["d3"] = Phase.OFFLINE
    api.service.tick()
    unknown = api("POST", "/api/v1/kill", json={"vehicles": ["d1", "d9"]})
    assert (unknown.status_code, unknown.json()["detail"]) == (
        404,
        "there is no vehicle 'd9'; there are d1, d2, d3",
    )
    offline = api("POST", "/api/v1/kill", json={"vehicles": ["d1", "d3"]})
    assert (offline.status_code, offline.json()["detail"][:13]) == (409, "d3 is offline")


def test_there_is_no_kill_in_one_step(api: Api) -> None:
    api.service.fly()
    assert api("POST", "/api/v1/vehicles/d1/kill").status_code == 404
    assert api.service.phases["d1"] is Phase.FORMATION


class WithoutControl:
    """A last resort that keeps what it was asked. Implements `LastResort`."""

    def __init__(self) -> None:
        self.command: CommandRecord | None = None

    async def kill(self, vehicle_ids: Sequence[str]) -> CommandRecord:
        outcomes = dict.fromkeys(vehicle_ids, VehicleOutcome(Outcome.DONE, "without control"))
        self.command = CommandRecord("outside-1", "kill", 1.0, outcomes, "local")
        return self.command

    def find(self, command_id: str) -> CommandRecord | None:
        return self.command if command_id == "outside-1" else None


def test_kill_is_sent_without_a_control_that_does_not_answer(
    api: Api, monkeypatch: pytest.MonkeyPatch
) -> None:
    api.service.fly()

    def kill(_vehicles: Sequence[str]) -> CommandRecord:
        raise LinkError("control does not answer")

    monkeypatch.setattr(api.service.commands, "kill", kill)
    code = api("POST", "/api/v1/kill", json={"vehicles": ["d2"]}).json()["code"]
    assert api("POST", "/api/v1/kill/confirm", json={"code": code}).status_code == 503
    api.app.state.context.last_resort = last_resort = WithoutControl()
    code = api("POST", "/api/v1/kill", json={"vehicles": ["d2"]}).json()["code"]
    answer = api("POST", "/api/v1/kill/confirm", json={"code": code})
    assert (answer.status_code, last_resort.command is not None) == (202, True)
    assert answer.json()["outcomes"] == {"d2": {"outcome": "done", "reason": "without control"}}
    assert api("GET", answer.headers["location"]).json() == answer.json()


def test_code_is_valid_for_its_time_and_its_principal() -> None:
    switch = KillSwitch()
    first = switch.arm(["d1"], "anna", 100.0)
    with pytest.raises(RefusedError, match="confirms nothing"):
        switch.confirm(first.code, "bert", 101.0)
    assert switch.confirm(first.code, "anna", 100.0 + VALID_S) == ("d1",)
    late = switch.arm(["d1"], "anna", 200.0)
    with pytest.raises(RefusedError, match="came too late"):
        switch.confirm(late.code, "anna", 200.1 + VALID_S)


def test_newest_of_many_codes_can_be_confirmed() -> None:
    codes = iter(f"{number:06x}" for number in range(10 * WAITING_MAX))
    switch = KillSwitch(lambda: next(codes))
    armed = [switch.arm(["d1"], "anna", 1.0) for _ in range(5 * WAITING_MAX)]
    assert switch.confirm(armed[-1].code, "anna", 2.0) == ("d1",)
    with pytest.raises(RefusedError, match="confirms nothing"):
        switch.confirm(armed[0].code, "anna", 2.0)


def test_no_caller_makes_the_codes_of_another_vanish() -> None:
    codes = iter(["000001", *(f"{number:06x}" for number in range(10 * WAITING_MAX))])
    switch = KillSwitch(lambda: next(codes))
    anna = switch.arm(["d1"], "anna", 1.0)
    berts = [switch.arm(["d2"], "bert", 1.0) for _ in range(5 * WAITING_MAX)]
    assert anna.code not in {each.code for each in berts}
    assert switch.confirm(anna.code, "anna", 2.0) == ("d1",)
