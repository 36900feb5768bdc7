"""Volumes by the authorities' formulas and by the fleet's own numbers, beside what a site draws."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.areas.site import AreaKind, FlightSite
from gcs.areas.volumes import (
    FleetKind,
    authority_volumes,
    compared,
    derived,
    drawn_m,
    fleet_volumes,
)
from gcs.cli.sites.fleet_kinds import ground_reach
from gcs.links.autopilots import AUTOPILOTS
from gcs.model.errors import SiteError
from gcs.model.setpoint_loss import WithoutSetpoints
from gcs.safety.impact import Airframe, ImpactSettings
from tests.support.fields import AUDIENCE, CONTINGENCY, GROUND_RISK, area, field, geography

PX4 = FleetKind(
    autopilot="PX4",
    vehicles=4,
    speed_m_s=6.0,
    climb_m_s=2.0,
    dimension_m=0.5,
    tilt_deg=45.0,
    tilt_source="",
    setpoint_timeout_s=0.2,
    loss=AUTOPILOTS["px4"].without_setpoints("hold", 1.0, {"COM_OF_LOSS_T": 1.0}),
    loss_source="",
    fence_period_s=0.0,
    reaction_s=0.8,
    deceleration_m_s2=2.0,
    error_m=0.0,
    error_source="",
    wind_m_s=0.0,
)
COPTER = replace(
    PX4,
    autopilot="ArduPilot",
    loss=AUTOPILOTS["ardupilot"].without_setpoints("hold", 3.0, {"GUID_TIMEOUT": 3.0, "WP_ACC": 2.5}),
)


def nowhere(_height_m: float, _speed_m_s: float) -> float:
    return 0.0


@pytest.mark.parametrize(("speed_m_s", "way_m"), [(3.0, 3.5), (6.0, 7.8)])
def test_the_generic_formula_is_what_authorities_publish(speed_m_s: float, way_m: float) -> None:
    """Of a vehicle of that speed that tilts by 45 degrees: one second, and its stop."""
    terms = authority_volumes(replace(PX4, speed_m_s=speed_m_s), 60.0).contingency.terms
    assert [term.value_m for term in terms[:3]] == [3.0, 3.0, 1.0]
    assert sum(term.value_m for term in terms[3:]) == pytest.approx(way_m, abs=0.05)


def test_heights_and_ground_of_the_formula() -> None:
    """By hand: 60 m high, 6 m/s: 1 + 4.2 + 1.83 m more, then a fall from 67 m, or as wide as high."""
    volumes = authority_volumes(PX4, 60.0)
    assert volumes.contingency_height.value_m == pytest.approx(7.03, abs=0.01)
    assert volumes.ground_risk.value_m == pytest.approx(6.0 * np.sqrt(2 * 67.03 / 9.81) + 0.25, abs=0.01)
    by_what = {extent.what: extent.value_m for extent in volumes.others}
    assert by_what["ground risk buffer, 1:1 rule"] == pytest.approx(67.28, abs=0.01)
    assert by_what["visual line of sight, at most"] == pytest.approx(327 * 0.5 + 20)
    assert by_what["flight geography, least extent"] == 1.5


def test_a_fall_begins_at_the_top_of_the_volume_that_is_drawn() -> None:
    """60 m are flown, 120 m are drawn above: vehicles may be there. What is too low is not believed."""
    assert authority_volumes(PX4, 60.0, 120.0).ground_risk.value_m == pytest.approx(
        6.0 * np.sqrt(2 * 120.0 / 9.81) + 0.25, abs=0.01
    )
    assert fleet_volumes(PX4, 60.0, lambda height_m, _: height_m, 120.0).ground_risk.value_m == 120.0
    for volumes in (authority_volumes(PX4, 60.0, 61.0), authority_volumes(PX4, 60.0)):
        assert volumes.ground_risk.value_m == pytest.approx(6.0 * np.sqrt(2 * 67.03 / 9.81) + 0.25, abs=0.01)


@pytest.mark.parametrize(
    ("kind", "speed_m_s", "way_m"),
    [(PX4, 3.0, 8.25), (PX4, 6.0, 21.0), (COPTER, 3.0, 12.75), (COPTER, 6.0, 29.1)],
)
def test_an_autopilot_flies_on_when_its_station_dies(kind: FleetKind, speed_m_s: float, way_m: float) -> None:
    """Two to four times the formula's reaction and stop."""
    ours = fleet_volumes(replace(kind, speed_m_s=speed_m_s), 60.0, nowhere).contingency
    assert ours.value_m == pytest.approx(way_m, abs=0.01)
    formula = authority_volumes(replace(kind, speed_m_s=speed_m_s), 60.0).contingency
    assert 2.3 < ours.value_m / (formula.value_m - 7.0) < 3.8


def test_every_cause_makes_the_fleet_s_volume_larger() -> None:
    def side_m(**changes: object) -> float:
        return fleet_volumes(replace(PX4, **changes), 60.0, nowhere).contingency.value_m  # type: ignore[arg-type]

    least_m = side_m()
    for changes in (
        {"speed_m_s": 7.0},
        {"setpoint_timeout_s": 0.3},
        {"loss": WithoutSetpoints(flies_on_s=2.0)},
        {"fence_period_s": 1.0},
        {"reaction_s": 1.2},
        {"deceleration_m_s2": 1.0},
        {"error_m": 0.5},
        {"wind_m_s": 8.0},
    ):
        assert side_m(**changes) > least_m, changes


def test_wind_counts_for_more_than_speed_of_light_vehicles() -> None:
    """0.35 kg from 60 m with 6 m/s: 21 m by the formula, and a third more in 8 m/s of wind."""
    light = ImpactSettings(
        airframe=Airframe(mass_kg=0.35, drag_area_m2=0.018, dimension_m=0.5), reaction_s=0.0
    )
    still = light.model_copy(update={"wind_max_m_s": 0.0})
    fall_m = ground_reach(light, (0.0,))(60.0, 6.0)
    assert 30.0 < fall_m < 40.0
    assert ground_reach(still, (0.0,))(60.0, 6.0) < 21.0 < 0.75 * fall_m


def test_a_site_is_compared_with_both() -> None:
    site = field(CONTINGENCY, GROUND_RISK)
    has_m = drawn_m(site)
    assert has_m["contingency volume, sideways"] == pytest.approx(16.0, abs=0.03)
    assert has_m["contingency volume, upwards"] == 15.0
    assert has_m["ground risk buffer"] == pytest.approx(44.0, abs=0.03)
    volumes = [authority_volumes(PX4, 45.0), fleet_volumes(PX4, 45.0, lambda *_: 50.0)]
    spare = {(each.what, each.method): each.spare_m for each in compared(site, volumes)}
    assert spare["ground risk buffer", "this fleet"] == pytest.approx(-6.0, abs=0.03)
    assert spare["contingency volume, sideways", "authorities"] == pytest.approx(16.0 - 14.83, abs=0.05)
    assert set(drawn_m(field()).values()) == {None}


def test_a_derived_site_is_as_wide_as_the_widest_computation() -> None:
    volumes = [authority_volumes(PX4, 45.0), fleet_volumes(PX4, 45.0, lambda *_: 30.0)]
    site = derived(field(), volumes)
    spares = [each.spare_m for each in compared(site, volumes)]
    assert all(spare is not None and spare > 0.0 for spare in spares), spares
    assert min(spare for spare in spares if spare is not None) < 0.3
    assert len(site.of(AreaKind.GROUND_RISK)[0].corners) == 6


def test_a_derived_site_that_meets_its_audience_is_refused() -> None:
    near = [(x - 60.0, y - 60.0) for x, y in AUDIENCE]
    site = FlightSite("near", (geography(), area(AreaKind.AUDIENCE, near)))
    with pytest.raises(SiteError, match="in common with ground-risk"):
        derived(site, [fleet_volumes(PX4, 45.0, lambda *_: 60.0)])
