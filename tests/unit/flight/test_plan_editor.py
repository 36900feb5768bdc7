"""What the orchestrator refuses of a wish, and that it looks at where the target is by then."""

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, Final

import async_solipsism
import httpx
import pytest

from gcs.api.app import create_app
from gcs.config.schema import Config
from gcs.flight.orchestrator import Orchestrator
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.plan import MAX_OBSTACLES, Formation, Obstacle, Orbit, Target
from tests.support.silent_link import SilentLink

RAW: Final[dict[str, Any]] = {
    "show_frame": {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_amsl_m": 400.0},
    "links": [{"name": "none", "listen": "udpin://127.0.0.1:14540", "vehicles": {"count": 1}}],
    "formation": {"radius_m": 10.0, "height_m": 20.0},
    "orbit": {"radius_m": 15.0},
}
CONFIG = Config.model_validate(RAW)


def request(story: Callable[[Orchestrator], Awaitable[None]], config: Config = CONFIG) -> None:
    """Play `story` with a service that does not run, on a clock that jumps."""

    async def main() -> None:
        await story(Orchestrator(config, [SilentLink(config.ids)]))

    with asyncio.Runner(loop_factory=async_solipsism.EventLoop) as runner:
        runner.run(main())


def test_accepted_changes_are_read_before_the_next_tick() -> None:
    async def story(service: Orchestrator) -> None:
        transport = httpx.ASGITransport(create_app(service))
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1/api/v1") as client:
            for path, change in (("/formation", {"radius_m": 11.0}), ("/orbit", {"radius_m": 20.0})):
                changed = await client.patch(path, json=change)
                assert (await client.get(path)).json() == changed.json()
                assert changed.json()["radius_m"] == change["radius_m"]
            await client.put("/target", json={"x_m": 5.0, "y_m": 6.0})
            assert (await client.get("/target")).json()["x_m"] == 5.0
            box = {"x_m": 50.0, "y_m": 50.0, "half_length_x_m": 2.0, "half_length_y_m": 2.0, "height_m": 9.0}
            added = (await client.post("/obstacles", json=box)).json()
            await client.put(f"/obstacles/{added['id']}", json={**box, "height_m": 7.0})
            listed = (await client.get("/obstacles")).json()
            assert [each["height_m"] for each in listed] == [7.0]
            await client.delete(f"/obstacles/{added['id']}")
            assert (await client.get("/obstacles")).json() == []

    request(story)


def refusal(request: Callable[[], None]) -> InvalidError:
    with pytest.raises(InvalidError) as refused:
        request()
    return refused.value


def test_change_is_refused_by_its_field_with_what_fits() -> None:
    async def story(service: Orchestrator) -> None:
        orbit = refusal(lambda: service.plan.set_orbit(Orbit(5000.0)))
        assert (orbit.field, orbit.value) == ("radius_m", 5000.0)
        assert "at most 288.0 m" in orbit.allowed
        target = refusal(lambda: service.plan.set_target(Target(280.0, 0.0)))
        assert target.field == "position"
        assert "within 273.0 m of the origin" in target.allowed
        service.plan.set_orbit(Orbit(260.0))
        sphere = refusal(lambda: service.plan.set_formation(Formation(45.0, 50.0)))
        assert (sphere.field, sphere.value) == ("radius_m", 45.0)
        assert "at most 38.0 m" in sphere.allowed
        service.plan.set_formation(Formation(38.0, 50.0))

    request(story)


def test_radius_is_checked_for_the_whole_fleet_while_offline() -> None:
    config = Config.model_validate(
        {**RAW, "links": [{**RAW["links"][0], "vehicles": {"count": 4}}]},
    )

    async def story(service: Orchestrator) -> None:
        refused = refusal(lambda: service.plan.set_formation(Formation(1.0, 20.0)))
        assert (refused.field, refused.value) == ("radius_m", 1.0)
        assert "for 4 vehicles" in refused.allowed

    request(story, config)


def test_too_large_radius_names_the_greatest_not_the_height() -> None:
    """Before: height_m = 20.0: at least 503.0 m."""

    async def story(service: Orchestrator) -> None:
        for radius_m in (18.0, 500.0, 1e300):
            refused = refusal(partial(service.plan.set_formation, Formation(radius_m, 20.0)))
            assert (refused.field, refused.value) == ("radius_m", radius_m)
            assert "at most 17.0 m at a height of 20 m" in refused.allowed
        service.plan.set_formation(Formation(17.0, 20.0))
        both = refusal(lambda: service.plan.set_formation(Formation(40.0, 25.0)))
        assert both.field == "height_m"

    request(story)


def test_orbit_and_sphere_are_checked_at_the_current_target() -> None:
    async def story(service: Orchestrator) -> None:
        service.plan.set_target(Target(0.0, 0.0, 3.0, 0.0))
        service.plan.set_orbit(Orbit(100.0))
        service.plan.set_orbit(Orbit(15.0))
        await asyncio.sleep(80.0)  # 240 m out
        assert "at most 48.0 m" in refusal(lambda: service.plan.set_orbit(Orbit(100.0))).allowed
        assert "at most 43.0 m" in refusal(lambda: service.plan.set_formation(Formation(44.0, 50.0))).allowed

    request(story)


def test_beyond_reach_a_change_that_is_no_larger_is_accepted() -> None:
    async def story(service: Orchestrator) -> None:
        service.plan.set_target(Target(0.0, 0.0, 4.0, 0.0))
        await asyncio.sleep(300.0)
        service.plan.set_formation(Formation(10.0, 30.0))
        service.plan.set_formation(Formation(8.0, 30.0))
        service.plan.set_orbit(Orbit(14.0))
        assert refusal(lambda: service.plan.set_orbit(Orbit(16.0))).field == "radius_m"

    request(story)


def test_too_many_obstacles_are_refused_with_their_number() -> None:
    async def story(service: Orchestrator) -> None:
        for index in range(MAX_OBSTACLES):
            service.plan.add_obstacle(Obstacle(str(index), 10.0 * index, 50.0, 1.0, 1.0, 5.0))
        with pytest.raises(RefusedError, match="there are 32 obstacles already"):
            service.plan.add_obstacle(Obstacle("one more", 0.0, 90.0, 1.0, 1.0, 5.0))
        service.plan.change_obstacle(Obstacle("0", 0.0, 60.0, 1.0, 1.0, 5.0))
        service.plan.remove_obstacle("0")
        service.plan.add_obstacle(Obstacle("one more", 0.0, 90.0, 1.0, 1.0, 5.0))

    request(story)
