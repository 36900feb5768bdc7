"""Where simulated flights start and where they lead."""

import numpy as np
import pytest

from gcs.formation.obstacles import AvoidanceSettings
from gcs.model.errors import ConfigError
from gcs.model.state import Array
from gcs.simulation import initial_states as layout
from gcs.simulation.obstacle_worlds import draw_world
from gcs.simulation.scenario import FormationFlight, GoalFlight, RandomObstacles


def nearest(place_m: Array, stretch: float = 1.0) -> float:
    offset = (place_m[:, None] - place_m[None]) * (1.0, 1.0, stretch)
    return float((np.linalg.norm(offset, axis=2) + np.diag(np.full(len(place_m), np.inf))).min())


def goals(layout_name: str, count: int, extent_m: float = 60.0) -> tuple[Array, Array]:
    flight = GoalFlight.model_validate({"kind": "goals", "layout": layout_name, "extent_m": extent_m})
    return layout.goals_m(flight, count, np.random.default_rng(3))


def test_assembly_sphere_grows_with_the_fleet_from_a_minimum() -> None:
    assert layout.assembly_radius_m(4) == 10.0
    assert layout.assembly_radius_m(100) == pytest.approx(14.0)


def test_pads_keep_their_spacing_and_hover_at_one_height() -> None:
    grid_m = layout.grid_m(20, 4.0, 5.0)
    assert nearest(grid_m) == pytest.approx(4.0)
    assert grid_m[:, 2].tolist() == [-5.0] * 20
    assert np.abs(grid_m[:, :2].mean(axis=0)).max() < 1e-9


def test_a_square_start_needs_a_square_number() -> None:
    flight = FormationFlight(kind="formation", start="square")
    random = np.random.default_rng(1)
    assert nearest(layout.formation_start_m(flight, 10.0, 4, random)) == pytest.approx(4.0)
    with pytest.raises(ConfigError, match="square number"):
        layout.formation_start_m(flight, 10.0, 5, random)


@pytest.mark.parametrize("count", [12, 212, 812])
def test_antipodal_start_is_farthest_and_legal(
    count: int,
) -> None:
    start_m, goal_m = goals("opposite", count, 100.0)
    assert np.linalg.norm(goal_m - start_m, axis=1) == pytest.approx(200.0)
    assert nearest(start_m) > 6.0
    assert nearest(goal_m) > 6.0


def test_random_places_in_the_cube_are_legal_and_differ() -> None:
    start_m, goal_m = goals("cube", 50)
    assert nearest(start_m, 1.0 / 1.5) >= 6.0
    assert nearest(goal_m, 1.0 / 1.5) >= 6.0
    assert np.linalg.norm(goal_m - start_m, axis=1).mean() > 10.0


def test_more_vehicles_than_fit_the_cube_are_refused() -> None:
    with pytest.raises(ConfigError, match="do not fit"):
        goals("cube", 50, 8.0)


def test_head_on_ranks_fly_to_the_opposite_side() -> None:
    start_m, goal_m = goals("head-on", 8)
    assert nearest(start_m) == pytest.approx(6.0)
    assert start_m[4:] == pytest.approx(start_m[:4] * (-1.0, 1.0, 1.0))
    assert (goal_m[:4, 0] > 0).all()
    assert (start_m[:4, 0] < 0).all()
    assert goal_m[:, 1:] == pytest.approx(start_m[:, 1:])


def test_crossing_streams_meet_at_right_angles() -> None:
    start_m, goal_m = goals("crossing", 8)
    first, second = (goal_m - start_m)[:4], (goal_m - start_m)[4:]
    assert (first * second).sum() == pytest.approx(0.0)
    assert nearest(start_m) >= 6.0 - 1e-9


@pytest.mark.parametrize("kind", ["closing", "walls", "closed"])
def test_sphere_begins_and_ends_clear_of_drawn_boxes(kind: str) -> None:
    settings = RandomObstacles.model_validate({"kind": kind})
    for seed in range(20):
        drawn = draw_world(np.random.default_rng(seed), settings, AvoidanceSettings(), 10.0)
        for box in drawn.boxes:
            for x_m, y_m in [(0.0, 0.0), drawn.target_m]:
                beside_m = np.hypot(
                    max(abs(x_m - box.x_m) - box.half_length_x_m, 0.0),
                    max(abs(y_m - box.y_m) - box.half_length_y_m, 0.0),
                )
                assert beside_m > 15.0


@pytest.mark.parametrize("seed", range(8))
def test_panel_slides_over_the_whole_doorway_and_past_it(seed: int) -> None:
    drawn = draw_world(
        np.random.default_rng(seed), RandomObstacles(kind="sliding"), AvoidanceSettings(), 10.0
    )
    panel, posts = drawn.boxes[-1], drawn.boxes[3:5]
    low_m, high_m = sorted(
        box.y_m + side * box.half_length_y_m for box, side in zip(posts, (1, -1), strict=True)
    )
    moments_s = np.arange(0.0, 165.0)
    at_m = np.array([panel.position_m(time_s)[1] for time_s in moments_s])
    covers = (at_m - panel.half_length_y_m <= low_m) & (at_m + panel.half_length_y_m >= high_m)
    clear = (at_m - panel.half_length_y_m > high_m) | (at_m + panel.half_length_y_m < low_m)
    assert high_m - low_m > 2.0 * 10.0
    assert covers[:22].any()
    assert clear[-1]
