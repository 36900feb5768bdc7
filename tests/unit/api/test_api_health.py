import asyncio
import math
from dataclasses import replace

import pytest

from gcs.api.auth.authorization import Authorization
from gcs.api.context import VIEWERS_MAX, Context
from gcs.api.schemas import convert
from gcs.model.errors import RefusedError
from tests.support.api_fake_service import FRAME, FakeService
from tests.support.api_harness import Api


@pytest.fixture(autouse=True)
def _patient() -> None:
    """The age of a state is the subject here."""


def test_health_is_green_while_ticks_come() -> None:
    api = Api()
    api.service.tick()
    answer = api("GET", "/healthz")
    assert answer.status_code == 200
    assert answer.json()["alive"] is True
    assert 0.0 <= answer.json()["view_age_s"] < convert.VIEW_AGE_MAX_S


@pytest.mark.parametrize("age_s", [1.5, 3600.0, -5.0, math.nan])
def test_health_is_red_with_old_state_whatever_it_reports(age_s: float) -> None:
    api = Api()
    view = api.service.view.value
    api.service.view.promise(lambda: replace(view, time_s=view.time_s - age_s, control_alive=True))
    answer = api("GET", "/healthz")
    assert answer.status_code == 503
    assert "the control loop does not run" in answer.json()["detail"]
    fleet = api("GET", "/api/v1/fleet").json()
    assert (fleet["control_alive"], bool(fleet["control_reason"])) == (False, True)


def test_health_is_red_when_control_reports_a_failure() -> None:
    api = Api()
    api.service.control_alive = False
    api.service.tick()
    answer = api("GET", "/healthz")
    assert answer.status_code == 503
    assert "no setpoints are sent" in answer.json()["detail"]


async def texts_around_the_moment_a_state_gets_old() -> list[str]:
    service = FakeService()
    context = Context(service, Authorization())
    late = replace(service.view.value, time_s=context_time_s() - convert.VIEW_AGE_MAX_S + 1.0)
    service.view.promise(lambda: late)
    fresh = [context.fleet_json(), context.fleet_json()]
    await asyncio.sleep(1.05)
    old = context.fleet_json()
    service.tick()
    return [*fresh, old, context.fleet_json()]


def context_time_s() -> float:
    return asyncio.get_running_loop().time()


def test_json_of_a_state_is_encoded_once_for_all_viewers() -> None:
    first, second, old, next_state = asyncio.run(texts_around_the_moment_a_state_gets_old())
    assert first is second
    assert '"control_alive":true' in first
    assert '"control_alive":false' in old
    assert '"control_alive":true' in next_state


def test_viewer_slots_are_limited_and_returned() -> None:
    context = Context(FakeService(), Authorization())
    for _ in range(2 * VIEWERS_MAX):
        with context.viewer_slot():
            pass
    viewer_slots = [context.viewer_slot() for _ in range(VIEWERS_MAX + 1)]
    for viewer_slot in viewer_slots[:-1]:
        viewer_slot.__enter__()
    with pytest.raises(RefusedError, match="32 viewers"):
        viewer_slots[-1].__enter__()


@pytest.mark.parametrize("heading", [0.0, 0.1, 90.0, 179.9, 180.0, 270.0, 359.9])
def test_heading_survives_the_show_frame_round_trip(heading: float) -> None:
    assert convert.heading_deg(convert.yaw_rad(heading, FRAME), FRAME) == pytest.approx(heading, abs=1e-9)


def test_a_heading_is_below_360() -> None:
    north = replace(FRAME, heading_deg=0.0)
    assert convert.heading_deg(-1e-18, north) == 0.0
    assert convert.heading_deg(-math.pi / 2, north) == pytest.approx(270.0)
