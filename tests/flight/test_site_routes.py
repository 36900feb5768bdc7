"""What any station accepts for all, on the ground: each reaches the station that it concerns."""

from math import pi

import pytest

from gcs.model.plan import YawPolicy
from tests.flight.test_site_api import BUS, call
from tests.support.virtual_site import SiteShow, fly_site, site_config


def test_change_of_some_fields_keeps_the_newer_others() -> None:
    async def story(show: SiteShow) -> None:
        await show.wait(3.0)
        await call(show, "north", "PATCH", "/orbit", json={"speed_m_s": 1.5})
        await call(show, "south", "PATCH", "/orbit", json={"radius_m": 7.0})  # of the orbit before
        await call(show, "north", "PATCH", "/formation", json={"height_m": 25.0})
        await call(show, "south", "PATCH", "/formation", json={"radius_m": 14.0})
        await call(show, "north", "PATCH", "/yaw", json={"policy": "fixed"})
        await call(show, "south", "PATCH", "/yaw", json={"heading_deg": 90.0})
        await show.wait(1.0)
        for each in show.stations.values():
            plan = each.view.plan
            assert (plan.orbit.radius_m, plan.orbit.speed_m_s) == (7.0, 1.5)
            assert (plan.formation.radius_m, plan.formation.height_m) == (14.0, 25.0)
            assert plan.yaw.policy is YawPolicy.FIXED
            assert plan.yaw.fixed_rad == pytest.approx(pi / 2)

    fly_site(story, site_config(2, 2), **BUS)


def test_refusal_of_the_lead_is_reported_where_it_was_asked() -> None:
    async def story(show: SiteShow) -> None:
        await show.wait(3.0)
        crate = {
            "id": "crate",
            "x_m": 60,
            "y_m": -60,
            "half_length_x_m": 1,
            "half_length_y_m": 1,
            "height_m": 5,
        }
        await call(show, "north", "POST", "/obstacles", json=crate)
        await call(show, "south", "POST", "/obstacles", json=crate | {"x_m": 80})
        await show.wait(1.0)
        texts = [event.text for event in show["south"].service.events.newest()]
        assert any(
            "station north refused add_obstacle of local: there is an obstacle crate" in one for one in texts
        )
        assert [box.x_m for box in show["south"].view.plan.obstacles] == [60.0]

    fly_site(story, site_config(2, 2), **BUS)
