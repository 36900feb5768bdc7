"""Every constraint, against the geometry it stands for, computed in another way; and none is missing."""

from dataclasses import dataclass
from math import hypot

import numpy as np
from hypothesis import assume, event, given
from hypothesis import strategies as st

from gcs.formation.obstacles import Ellipse
from gcs.model.plan import Obstacle
from gcs.model.state import Array, Mask
from gcs.safety.constraints import NO_ROW
from gcs.safety.lost_paths import keepout_constraints
from gcs.safety.separation import Pairs, separation_constraints
from gcs.safety.walls import fence_constraints, nearest_way_out, obstacle_constraints
from tests.support.law_fleets import masks, obstacles, places, vectors, within
from tests.support.safety_fleets import CALM, SAFETY

BRAKING = SAFETY.braking
EVERYTHING_M_S = 1e4


def stopping_speed_m_s(gap_m: float) -> float:
    """From which one stops within the gap; inside of it, how fast one is to leave. Tested by hand."""
    return float(BRAKING.speed_m_s(np.array(gap_m)))


# pairs


@dataclass(frozen=True)
class Fleet:
    """Vehicles in the air and on their pads, some of them somebody else's, some of them unknown."""

    position_m: Array
    velocity_m_s: Array
    commanded: Mask
    airborne: Mask
    uncertainty_m: Array

    def pairs(self, course_m_s: Array, spare_m_s: Array) -> Pairs:
        return separation_constraints(
            self.position_m,
            self.velocity_m_s,
            self.commanded,
            self.airborne,
            floor=SAFETY.floor,
            braking=BRAKING,
            uncertainty_m=self.uncertainty_m,
            course_m_s=course_m_s,
            spare_m_s=spare_m_s,
        )

    def every_pair(self) -> Pairs:
        n = len(self.position_m)
        return self.pairs(np.zeros((n, 3)), np.full(n, EVERYTHING_M_S))


@st.composite
def fleets(draw: st.DrawFn, count: int = 4) -> Fleet:
    position = draw(vectors(count, 12.0)) * (1.0, 1.0, 0.5) - (0.0, 0.0, 6.5)  # heights of 0.5 to 12.5 m
    velocity = draw(vectors(count, 6.0))
    velocity[draw(masks(count)) & draw(masks(count)) & draw(masks(count))] = np.nan
    position[draw(masks(count)) & draw(masks(count)) & draw(masks(count))] = np.nan
    unsure = np.array(draw(st.lists(within(0.0, 1.0), min_size=count, max_size=count)))
    return Fleet(position, velocity, draw(masks(count)) | draw(masks(count)), draw(masks(count)), unsure)


def ellipsoid(unsure_m: float, flying: int) -> tuple[float, float]:
    """Semi-axes, sideways and up, of a pair of which so many are in the air: half the margin is for each."""
    floor = SAFETY.floor
    margin_m = floor.margin_m * flying / 2.0
    tall_m = floor.vertical_m * (1.0 + margin_m / floor.horizontal_m)
    return floor.horizontal_m + margin_m + unsure_m, tall_m + floor.vertical_uncertainty * unsure_m


def expected(fleet: Fleet, i: int, j: int) -> tuple[Array, float]:
    """Normal and bound of vehicle i against j."""
    flying = int(fleet.airborne[i]) + int(fleet.airborne[j])
    mine_m, theirs_m = fleet.uncertainty_m[[i, j]].tolist()
    if flying == 1:  # what stands counts as no less certain than what flies
        theirs_m, mine_m = (
            (min(theirs_m, mine_m), mine_m) if fleet.airborne[i] else (theirs_m, min(mine_m, theirs_m))
        )
    wide_m, tall_m = ellipsoid(SAFETY.floor.deviations * hypot(mine_m, theirs_m), flying)
    away_m = fleet.position_m[i] - fleet.position_m[j]
    axes_m = np.array([wide_m, wide_m, tall_m])
    level = np.linalg.norm(away_m / axes_m)  # 1 on the ellipsoid
    gradient = away_m / axes_m**2 / level
    steep = np.linalg.norm(gradient)
    normal, gap_m = gradient / steep, (level - 1.0) / steep
    measured = np.nan_to_num(fleet.velocity_m_s)
    closing_m_s = -float(normal @ (measured[i] - measured[j]))
    allowed_m_s = stopping_speed_m_s(float(gap_m) - BRAKING.lead_s * max(closing_m_s, 0.0))
    return normal, -allowed_m_s if fleet.commanded[j] else float(normal @ measured[j]) - allowed_m_s


def concerned(fleet: Fleet) -> list[tuple[int, int]]:
    """Pairs that count, the commanded one first."""
    low = -fleet.position_m[:, 2] < SAFETY.floor.pad_height_m
    known: Mask = np.asarray(np.isfinite(fleet.position_m).all(axis=1))
    pairs = []
    for i, j in zip(*np.triu_indices(len(low), 1), strict=True):
        exempt = (low[i] and low[j]) or not (fleet.airborne[i] or fleet.airborne[j])
        if known[i] and known[j] and not exempt and (fleet.commanded[i] or fleet.commanded[j]):
            pairs.append((int(i), int(j)) if fleet.commanded[i] else (int(j), int(i)))
    return pairs


@CALM
@given(fleets())
def test_every_relevant_pair_is_held_to_its_braking_speed(fleet: Fleet) -> None:
    found = fleet.every_pair()
    assert sorted(zip(found.first.tolist(), found.other.tolist(), strict=True)) == sorted(concerned(fleet))
    event(f"pairs: {len(found)}")
    for k in range(len(found)):
        i, j = int(found.first[k]), int(found.other[k])
        assert found.second[k] == (j if fleet.commanded[j] else NO_ROW)
        assume(np.linalg.norm(fleet.position_m[i] - fleet.position_m[j]) > 1e-3)
        normal, bound_m_s = expected(fleet, i, j)
        assert np.allclose(found.normal[k], normal, atol=1e-9)
        assert np.isclose(found.bound_m_s[k], bound_m_s, atol=1e-6)


@CALM
@given(fleets(), vectors(4, 4.0), st.lists(within(0.0, 4.0), min_size=4, max_size=4), within(1.0, 9.0))
def test_pair_is_omitted_only_if_no_reachable_velocity_breaks_it(
    fleet: Fleet, course_m_s: Array, spare: list[float], wider: float
) -> None:
    position_m = fleet.position_m * (wider, wider, 1.0)
    fleet = Fleet(position_m, fleet.velocity_m_s, fleet.commanded, fleet.airborne, fleet.uncertainty_m)
    every, kept = fleet.every_pair(), fleet.pairs(course_m_s, np.array(spare))
    kept_pairs = {frozenset(pair) for pair in zip(kept.first.tolist(), kept.other.tolist(), strict=True)}
    measured = np.nan_to_num(fleet.velocity_m_s)
    course = np.where(fleet.commanded[:, None], course_m_s, measured)
    far = np.where(fleet.commanded, spare, 0.0)
    for k in range(len(every)):
        i, j = int(every.first[k]), int(every.other[k])
        least_m_s = float(every.normal[k] @ (course[i] - course[j])) - far[i] - far[j]
        bound_m_s = every.bound_m_s[k]
        if not fleet.commanded[j]:
            bound_m_s -= float(every.normal[k] @ measured[j])
        assert (frozenset((i, j)) in kept_pairs) == (least_m_s <= bound_m_s) or abs(
            least_m_s - bound_m_s
        ) < 1e-6


# paths of lost vehicles


@CALM
@given(places(3), masks(3), vectors(4, 30.0), within(0.0, 2.0))
def test_vehicles_are_kept_off_the_nearest_point_of_each_path(
    position: Array, commanded: Mask, ends: Array, unsure_m: float
) -> None:
    segments = (ends - (0.0, 0.0, 30.0)).reshape(2, 2, 3)
    floor = SAFETY.floor
    found = keepout_constraints(
        position, commanded, segments, floor=floor, braking=BRAKING, uncertainty_m=np.full(3, unsure_m)
    )
    assert found.first.tolist() == [row for row in np.flatnonzero(commanded).tolist() for _ in segments]
    assert (found.second == NO_ROW).all()
    shares = np.linspace(0.0, 1.0, 20001)[:, None]
    for k, row in enumerate(found.first.tolist()):
        start, end = segments[k % 2]
        away_m = position[row] - (start + shares * (end - start))
        scaled_m = np.linalg.norm(away_m * floor.scale, axis=1)
        nearest_m = away_m[scaled_m.argmin()]
        assume(scaled_m.min() > 0.1)
        gradient = nearest_m * floor.scale**2 / scaled_m.min()
        kept_m = floor.horizontal_m + floor.margin_m + floor.deviations * hypot(unsure_m, unsure_m)
        gap_m = float((scaled_m.min() - kept_m) / np.linalg.norm(gradient))
        broken = (found.first == row) & (found.bound_m_s > 0.0)
        if broken.sum() > 1:  # one way out of both, at the greater of their speeds
            assert found.bound_m_s[k] >= -stopping_speed_m_s(gap_m) - 1e-2
            assert np.isclose(np.linalg.norm(found.normal[k]), 1.0)
            if broken[k]:
                assert np.allclose(found.normal[broken], found.normal[k])
                assert np.allclose(found.bound_m_s[broken], found.bound_m_s[k])
                continue
        assert np.allclose(found.normal[k], gradient / np.linalg.norm(gradient), atol=2e-2)
        assert np.isclose(found.bound_m_s[k], -stopping_speed_m_s(gap_m), atol=1e-2)


@CALM
@given(vectors(4, 80.0), masks(4), vectors(2, 30.0), within(0.5, 9.0))
def test_path_is_omitted_only_beyond_twice_the_speed(
    position: Array, commanded: Mask, ends: Array, fastest_m_s: float
) -> None:
    every, kept = (
        keepout_constraints(
            position,
            commanded,
            ends.reshape(1, 2, 3),
            floor=SAFETY.floor,
            braking=BRAKING,
            uncertainty_m=np.zeros(4),
            fastest_m_s=speed,
        )
        for speed in (np.inf, fastest_m_s)
    )
    assert kept.first.tolist() == every.first[every.bound_m_s >= -2.0 * fastest_m_s].tolist()


# walls


@CALM
@given(vectors(3, 350.0), vectors(3, 8.0), masks(3), masks(3), within(1.0, 9.0), within(0.0, 2.0))
def test_vehicles_are_kept_off_every_reachable_fence_side(
    spread: Array,
    velocity: Array,
    commanded: Mask,
    descending: Mask,
    fastest_m_s: float,
    standoff_m: float,
) -> None:
    position = spread * (1.0, 1.0, 0.2) - (0.0, 0.0, 50.0)
    fence = SAFETY.fence
    found = fence_constraints(
        position,
        commanded,
        descending,
        fence,
        BRAKING,
        velocity_m_s=velocity,
        standoff_m=np.full(3, standoff_m),
        fastest_m_s=fastest_m_s,
    )
    reported = []
    for row in np.flatnonzero(commanded).tolist():
        x_m, y_m, height_m = position[row] * (1.0, 1.0, -1.0)
        away_m = np.hypot(x_m, y_m)
        assume(away_m > 1e-3)
        sides: list[tuple[str, float, tuple[float, float, float]]] = [
            ("least height", height_m - fence.height_min_m, (0.0, 0.0, -1.0)),
            ("greatest height", fence.height_max_m - height_m, (0.0, 0.0, 1.0)),
            ("greatest distance", fence.distance_max_m - away_m, (-x_m / away_m, -y_m / away_m, 0.0)),
        ]
        for reason, gap_m, inward in sides[1:] if descending[row] else sides:
            goes_on_m = BRAKING.lead_s * max(0.0, -float(velocity[row] @ inward))
            allowed_m_s = stopping_speed_m_s(gap_m - standoff_m - goes_on_m)
            if allowed_m_s <= 2.0 * fastest_m_s:
                reported.append((row, reason, *inward, -allowed_m_s))
    assert found.first.tolist() == [one[0] for one in reported]
    assert list(found.reason) == [one[1] for one in reported]
    assert np.allclose(found.normal, np.array([one[2:5] for one in reported]).reshape(-1, 3))
    assert np.allclose(found.bound_m_s, [one[5] for one in reported], atol=1e-6)


def beyond_m(position_m: Array, box: Ellipse) -> Array:
    """(n, 3) how far past the box's sides, and above its top; negative: inside of them."""
    half_x_m, half_y_m = box.semi_x_m / np.sqrt(2.0), box.semi_y_m / np.sqrt(2.0)
    beside = np.abs(position_m[:, :2] - (box.x_m, box.y_m)) - (half_x_m, half_y_m)
    return np.column_stack([beside, -position_m[:, 2] - box.top_height_m])


@CALM
@given(places(4), obstacles())
def test_way_out_of_a_box_is_shortest_and_ends_on_its_surface(position: Array, obstacle: Obstacle) -> None:
    box = Ellipse.around(obstacle, margin_m=2.0, headroom_m=3.0)
    found = obstacle_constraints(position, np.ones(4, bool), {"b": box}, BRAKING)
    half_m = np.array([[box.semi_x_m, box.semi_y_m]]) / np.sqrt(2.0)
    outward, gap_m = nearest_way_out(
        position, np.array([[box.x_m, box.y_m]]), half_m, np.array([box.top_height_m])
    )
    beyond = beyond_m(position, box)
    outside: Mask = np.asarray((beyond > 0.0).any(axis=1))
    event(f"inside: {(~outside).any()}")
    assert np.allclose(gap_m[outside, 0], np.linalg.norm(np.maximum(beyond[outside], 0.0), axis=1))
    assert np.allclose(gap_m[~outside, 0], beyond[~outside].max(axis=1))
    assert np.allclose(np.linalg.norm(outward[:, 0], axis=1), 1.0)
    surface = beyond_m(position - gap_m * outward[:, 0], box).max(axis=1)
    assert np.allclose(surface, 0.0, atol=1e-9)
    walls = np.array(["below" not in reason for reason in found.reason])
    assert found.first[walls].tolist() == [0, 1, 2, 3]
    assert found.first[~walls].tolist() == [
        row for row in range(4) if not outside[row] and beyond[row, 2] < beyond[row, :2].max()
    ]
    assert np.allclose(
        found.bound_m_s[walls], [-stopping_speed_m_s(float(gap)) for gap in gap_m[:, 0]], atol=1e-6
    )
    assert np.allclose(found.bound_m_s[~walls], 0.0)
    assert np.allclose(found.normal[~walls], (0.0, 0.0, -1.0))


@CALM
@given(within(2.0, 20.0), st.booleans(), within(0.0, 1.5), within(0.0, 1.5), within(0.0, 1.5))
def test_wander_never_allows_a_faster_approach(
    apart_m: float, above: bool, mine: float, theirs: float, more: float
) -> None:
    position = np.array([[0.0, 0.0, -30.0], [0.0, 0.0, -30.0]])
    position[1, 2 if above else 0] += apart_m

    def allowed_m_s(*wander_m: float) -> float:
        pairs = separation_constraints(
            position,
            np.zeros((2, 3)),
            np.ones(2, np.bool_),
            np.ones(2, np.bool_),
            floor=SAFETY.floor,
            braking=BRAKING,
            uncertainty_m=np.zeros(2),
            wander_m=np.array(wander_m),
            course_m_s=np.zeros((2, 3)),
            spare_m_s=np.full(2, EVERYTHING_M_S),
        )
        return -float(pairs.bound_m_s[0])

    assert allowed_m_s(mine + more, theirs) <= allowed_m_s(mine, theirs) <= allowed_m_s(0.0, 0.0)
