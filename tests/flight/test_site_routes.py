"""What any station accepts for all, on the ground: each reaches the station that it concerns."""

from math import pi

import pytest

from gcs.model.errors import RefusedError
from gcs.model.plan import YawPolicy
from gcs.service import ShowAction
from gcs.testing.virtual_site import SiteShow, fly_site, site_config
from tests.flight.test_site_api import BUS, call


@pytest.mark.soak
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


@pytest.mark.soak
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


@pytest.mark.soak
def test_exclusion_reaches_the_station_that_flies_the_vehicle() -> None:
    async def story(show: SiteShow) -> None:
        await show.wait(3.0)
        record = await call(show, "south", "POST", "/vehicles/n1/exclude", json={"reason": "propeller"})
        assert record["outcomes"]["n1"]["outcome"] == "pending"
        await show.wait(1.0)
        record = await call(show, "south", "GET", f"/commands/{record['id']}")
        assert record["outcomes"]["n1"]["outcome"] == "done"
        assert "propeller" in record["outcomes"]["n1"]["reason"]
        owner = show["north"].service
        assert owner.command_log.newest()[0].by == "local"
        flies = {one.id: one.flies for one in owner.preflight.report().vehicles}
        assert flies == {"n1": False, "n2": True}
        listed = {each["id"]: each["reason"] for each in (await call(show, "south", "GET", "/vehicles"))}
        assert "propeller" in listed["n1"]
        for vehicle, expected in (("n1", "done"), ("n2", "failed")):
            record = await call(show, "south", "POST", f"/vehicles/{vehicle}/include")
            await show.wait(1.0)
            record = await call(show, "south", "GET", f"/commands/{record['id']}")
            assert record["outcome"] == expected
        assert record["outcomes"]["n2"]["reason"] == "station north: n2 was not taken out of the show"
        await show["north"].kill()
        await show.wait(1.0)
        record = await call(show, "south", "POST", "/vehicles/n1/exclude")
        assert record["outcomes"]["n1"] == {"outcome": "failed", "reason": "station north is not received"}

    fly_site(story, site_config(2, 2), **BUS)


def test_pads_of_two_stations_are_too_near() -> None:
    async def story(show: SiteShow) -> None:
        await show.wait(4.0)
        site = {}
        for name in show.stations:
            report = show[name].service.preflight.report()
            near = [
                each for one in report.vehicles for each in one.checks if each.name == "distance to the next"
            ]
            site[name] = "; ".join(each.problem for each in near)
        assert "of station south" in site["north"]
        assert "of station north" in site["south"]
        with pytest.raises(RefusedError, match="m from n1 of station north"):
            show["north"].service.commands.command_show(ShowAction.START)

    wide = {
        "control": {"safety": {"floor": {"horizontal_m": 4.0}}},
        "formation": {"radius_m": 30.0, "height_m": 40.0},
    }
    fly_site(story, site_config(2, 1, **wide), **BUS)
