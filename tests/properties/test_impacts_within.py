"""Motors off at random moments of flights within random concave sites: no vehicle falls outside.

`gcs simulate --row site` flies hundreds of such flights; here some short ones show that the row is kept, and
the filter alone is asked for every state that Hypothesis finds.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model.state import Array
from gcs.safety.constraints import TOLERANCE_M_S, Braking
from gcs.safety.controlled_ground import ground_constraints, ground_margins
from gcs.safety.fenced_areas import FencedArea
from gcs.safety.filter import filter_velocities
from gcs.safety.floor import Floor
from gcs.safety.impact import Airframe, ImpactSettings
from gcs.safety.surroundings import SafetySettings
from gcs.safety.walls import Fence
from gcs.simulation.batch import Run, run_once
from gcs.simulation.falls import fallen
from gcs.simulation.random_sites import drawn_site, places_m
from gcs.simulation.scenario import GoalFlight, RandomSite, Scenario
from gcs.simulation.site_figures import is_within
from tests.support.safety_fleets import CALM, around

TICK_S = 0.05
AIRFRAMES = st.sampled_from(
    [
        Airframe(mass_kg=0.35, drag_area_m2=0.018, dimension_m=0.35),
        Airframe(mass_kg=1.3, drag_area_m2=0.035, dimension_m=0.5),
        Airframe(mass_kg=3.0, drag_area_m2=0.06, dimension_m=0.8),
    ]
)
SEEDS = st.integers(0, 10**6)


def ground_of(seed: int, airframe: Airframe) -> tuple[FencedArea, ImpactSettings, np.random.Generator]:
    """A random concave ground for that vehicle."""
    random = np.random.default_rng(seed)
    site = RandomSite(areas=False, ground=True, extent_min_m=90.0, extent_max_m=150.0)
    flight = GoalFlight(kind="goals", layout="cube", extent_m=60.0, site=site)
    scenario = Scenario.build(60.0, "goals", flight=flight.model_dump())
    drawn = drawn_site(scenario, site, random)
    ground = drawn.scenario.control.safety.fence.controlled_ground
    assert ground is not None
    return ground, ImpactSettings(airframe=airframe, wind_max_m_s=float(random.uniform(0.0, 10.0))), random


def flown(start_m: Array, pace_m_s: Array, desired_m_s: Array, safety: SafetySettings) -> tuple[Array, Array]:
    """(t, n, 3) positions and velocities of vehicles that follow the filter's velocities late."""
    place_m, pace_m_s, places, paces = start_m.copy(), pace_m_s.copy(), [], []
    for _ in range(round(12.0 / TICK_S)):
        allowed_m_s, _ = filter_velocities(
            desired_m_s, replace(around(place_m), velocity_m_s=pace_m_s), safety
        )
        change = (1.0 - np.exp(-TICK_S / 0.4)) * (allowed_m_s - pace_m_s)
        most = 3.0 * TICK_S / np.maximum(np.linalg.norm(change, axis=1, keepdims=True), 1e-9)
        pace_m_s = pace_m_s + change * np.minimum(1.0, most)
        place_m = place_m + TICK_S * pace_m_s
        places.append(place_m)
        paces.append(pace_m_s)
    return np.array(places), np.array(paces)


@settings(CALM, max_examples=max(6, settings().max_examples // 12))
@given(SEEDS, AIRFRAMES)
def test_no_desired_velocity_leads_an_impact_out(seed: int, airframe: Airframe) -> None:
    """Vehicles at rest anywhere on random ground desire anything; whenever motors stop, all fall inside."""
    ground, impact, random = ground_of(seed, airframe)
    ring = np.array(ground.corners_m)
    start_m = random.uniform(-1.0, 1.0, (200, 3)) * (*np.abs(ring).max(axis=0), 0.0)
    start_m[:, 2] = -random.uniform(4.0, 60.0, 200)
    inside = ground_margins(start_m, np.zeros((200, 3)), ground, impact).margin_m > impact.soft_m
    start_m = start_m[inside][:8]
    if len(start_m) == 0:
        return
    desired_m_s = random.normal(0.0, 5.0, (len(start_m), 3)) * (1.0, 1.0, 0.3)
    fence = Fence(controlled_ground=ground, height_max_m=80.0)
    alone = Floor(horizontal_m=1e-3, vertical_m=1e-3, margin_m=0.0, uncertainty_m=0.0)
    safety = SafetySettings(fence=fence, impact=impact, floor=alone)
    places_m, paces_m_s = flown(start_m, np.zeros_like(start_m), desired_m_s, safety)
    moments = random.integers(0, len(places_m), 40)
    place_m, pace_m_s = places_m[moments].reshape(-1, 3), paces_m_s[moments].reshape(-1, 3)
    turn_rad, wind_m_s = random.uniform(0.0, 2.0 * np.pi, len(place_m)), np.zeros_like(place_m)
    wind_m_s[:, 0], wind_m_s[:, 1] = np.cos(turn_rad), np.sin(turn_rad)
    wind_m_s *= impact.wind_max_m_s * random.choice([1.0, 1.0, 0.5], len(place_m))[:, None]
    late_s = impact.reaction_s * random.uniform(0.0, 1.0, len(place_m))
    hit_m, _, _ = fallen(place_m, pace_m_s, wind_m_s, airframe, reaction_s=late_s)
    assert is_within(ring, hit_m).all()
    margins = ground_margins(places_m.reshape(-1, 3), paces_m_s.reshape(-1, 3), ground, impact)
    assert margins.margin_m.min() >= 0.0


@given(SEEDS, AIRFRAMES)
def test_every_wall_of_the_ground_holds_in_the_next_tick(seed: int, airframe: Airframe) -> None:
    """What the filter leaves breaks no row of the ground that rest keeps."""
    ground, impact, random = ground_of(seed, airframe)
    place_m = random.uniform(-100.0, 100.0, (6, 3))
    place_m[:, 2] = -random.uniform(4.0, 60.0, 6)
    desired_m_s = random.normal(0.0, 6.0, (6, 3))
    safety = SafetySettings(fence=Fence(controlled_ground=ground, distance_max_m=1e4), impact=impact)
    allowed_m_s, _ = filter_velocities(desired_m_s, around(place_m), safety)
    rows = ground_constraints(
        place_m,
        np.ones(6, np.bool_),
        ground,
        impact,
        Braking(),
        velocity_m_s=np.zeros((6, 3)),
        standoff_m=safety.floor.standoff_m(np.zeros(6)),
        fastest_m_s=safety.limits.fastest_m_s,
    )
    kept = rows.bound_m_s <= 0.0
    assert (rows.slack_m_s(allowed_m_s)[kept] >= -2.0 * TOLERANCE_M_S).all()


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("site-ground", 7000),  # a vehicle stands at the one corner that another has to pass
        pytest.param("site-ground", 6000, marks=pytest.mark.soak),
        pytest.param("site-ground", 7041, marks=pytest.mark.soak),  # a goal near a wall, behind a corner
        pytest.param("site-formation", 6000, marks=pytest.mark.soak),
        pytest.param("site-formation", 7010, marks=pytest.mark.soak),  # one waits beside a wall
    ],
)
def test_motors_that_stop_in_flight_let_no_vehicle_fall_out(name: str, seed: int) -> None:
    """500 falls of a flight in wind, of PX4's model; all arrive. `make soak` adds formations that return."""
    figures = run_once(Run(Scenario.load(name), None, seed))
    assert figures["failed"] == []


def test_drawn_sites_have_room_and_ways() -> None:
    """Starts and goals are inside, and apart."""
    site = RandomSite(outside_share=0.5)
    scenario = Scenario.load("site-goals")
    for seed in range(6):
        random = np.random.default_rng(seed)
        drawn = drawn_site(scenario, site, random)
        ring = np.array(drawn.scenario.control.safety.fence.areas[0].corners_m)
        start_m = places_m(drawn, site, 6, 7.0, random, 3)
        assert is_within(ring, start_m[:, :2]).tolist() == [False] * 3 + [True] * 3
        apart_m = np.linalg.norm(start_m[:, None, :2] - start_m[None, :, :2], axis=2) + 9.0 * np.eye(6)
        assert apart_m.min() >= 7.0
