"""What the filter may never do to a pair, whatever is desired."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, event, given
from hypothesis import strategies as st

from gcs.model.state import Array, Mask
from gcs.safety.across_stations import CHANGE_M_S
from gcs.safety.filter import cap, filter_velocities
from tests.support.law_fleets import masks, vectors, within
from tests.support.safety_fleets import (
    CALM,
    LIMITS,
    OPEN,
    SAFETY,
    TICK_S,
    around,
    assert_within_limits,
    closest,
    least_slack_m_s,
    legal_fleets,
)

TICKS = 8


@CALM
@given(legal_fleets())
def test_filter_keeps_legal_pairs_above_the_floor_in_one_step(
    fleet: tuple[Array, Array],
) -> None:
    position, desired = fleet
    allowed, _ = filter_velocities(desired, around(position), SAFETY)
    assert closest(position + TICK_S * allowed) >= SAFETY.floor.horizontal_m - 1e-3


@CALM
@given(legal_fleets())
def test_floor_and_margin_hold_for_the_whole_reaction_time(
    fleet: tuple[Array, Array],
) -> None:
    position, desired = fleet
    apart_m = SAFETY.floor.horizontal_m + SAFETY.floor.margin_m
    assume(closest(position) >= apart_m)
    allowed, _ = filter_velocities(desired, around(position), SAFETY)
    for later_s in np.linspace(0.0, SAFETY.braking.reaction_s, 6):
        assert closest(position + later_s * allowed) >= apart_m - 2e-3


@CALM
@given(legal_fleets(), masks(6))
def test_two_stations_keep_their_pairs_apart(fleet: tuple[Array, Array], mask: Mask) -> None:
    """Each knows what the other's filter was given and what it allowed last: it settles within some ticks."""
    position, desired = fleet
    assume(closest(position) >= SAFETY.floor.horizontal_m + SAFETY.floor.margin_m)
    one, own = around(position), mask[: len(position)]
    together = np.zeros_like(desired)
    for _ in range(TICKS):
        allowed = np.zeros_like(desired)
        for part in (own, ~own):
            station = replace(one, commanded=part, shared_m_s=np.where(part[:, None], np.nan, together))
            allowed += filter_velocities(desired, station, SAFETY)[0]
        together = allowed
    assert least_slack_m_s(together, one) >= -CHANGE_M_S - 2e-3
    event(f"{int(own.sum())} of {len(own)} are the first station's")


@CALM
@given(
    legal_fleets(), masks(6), vectors(6, 5.0), st.permutations(range(6)), within(-3.0, 3.0), vectors(1, 50.0)
)
def test_filter_is_invariant_to_place_heading_and_order(
    fleet: tuple[Array, Array], mask: Mask, moving: Array, permutation: list[int], turn: float, away: Array
) -> None:
    position, desired = fleet
    assume(closest(position) >= SAFETY.floor.horizontal_m + SAFETY.floor.margin_m)
    n = len(position)
    here = replace(around(position, commanded=mask[:n]), velocity_m_s=moving[:n])
    order = np.array([row for row in permutation if row < n])
    turned = np.array(
        [[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]]
    )
    there = replace(
        around((position[order] + away * (1.0, 1.0, 0.0)) @ turned.T, commanded=here.commanded[order]),
        velocity_m_s=moving[order] @ turned.T,
    )
    allowed, _ = filter_velocities(desired, here, OPEN)
    again, _ = filter_velocities(desired[order] @ turned.T, there, OPEN)
    event(f"restrained: {not np.allclose(allowed, cap(desired, LIMITS))}")
    both = (allowed, here), (again, there)
    assert all(least_slack_m_s(*one, that_rest_keeps=True) >= -2e-3 for one in both)
    # vehicles that are not commanded can close in from opposite sides: then no velocity is the right one
    contradict = any(least_slack_m_s(*one) < -0.01 for one in both)
    event(f"contradictory constraints: {contradict}")
    assert contradict or np.allclose(again, allowed[order] @ turned.T, atol=0.05)


@CALM
@given(legal_fleets(), masks(6))
def test_filter_keeps_limits_and_moves_only_commanded_vehicles(
    fleet: tuple[Array, Array], mask: Mask
) -> None:
    position, desired = fleet
    commanded = mask[: len(position)]
    allowed, reasons = filter_velocities(desired, around(position, commanded=commanded), SAFETY)
    assert_within_limits(allowed)
    assert not allowed[~commanded].any()
    assert not any(reason for reason, ours in zip(reasons, commanded, strict=True) if not ours)


@CALM
@given(legal_fleets())
def test_velocities_that_break_nothing_come_back_unchanged(fleet: tuple[Array, Array]) -> None:
    position, desired = fleet
    allowed, _ = filter_velocities(desired, around(position), SAFETY)
    again, reasons = filter_velocities(allowed, around(position), SAFETY)
    assume(closest(position) >= SAFETY.floor.horizontal_m + SAFETY.floor.margin_m)
    assert np.allclose(again, allowed, atol=5e-3)
    assert not any(reasons)


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4), (0, 2, 1, 3, 4)])
def test_vehicle_between_others_escapes_in_either_order(order: tuple[int, ...]) -> None:
    """Row 4 must evade row 2 towards row 1, which leaves it hardly any room: it has to climb."""
    rows = list(order)
    position = np.array(
        [[3.0, 0.0, -30.0], [0.0, -3.0, -30.0], [0.0, 3.0, -29.0], [0.0, 0.0, -26.0], [0.0, 0.0, -30.0]]
    )[rows]
    moving, desired = np.zeros((5, 3)), np.zeros((5, 3))
    moving[order.index(2)], desired[4] = (0.0, -1.0, -1.0), (0.0, -1.0, 0.0)
    here = replace(around(position, commanded=np.arange(5) == 4), velocity_m_s=moving)
    allowed, _ = filter_velocities(desired, here, OPEN)
    assert least_slack_m_s(allowed, here) >= -2e-3
    assert allowed[4] == pytest.approx([0.0, -0.715, -2.085], abs=2e-3)
