"""What yields where constraints contradict each other: what is less certain, for what is more."""

from dataclasses import replace

import numpy as np

from gcs.model.jit import kernel
from gcs.model.state import Array, Mask
from gcs.safety.constraints import NO_ROW, Braking, Constraints, slack_m_s
from gcs.safety.floor import Floor
from gcs.safety.neighbours import Rows
from gcs.safety.separation import Pairs
from gcs.safety.surroundings import Surroundings
from gcs.safety.walls_of_each import obstacles_around

NOTICEABLE_M_S = 0.05
"""A velocity that a constraint changes by less counts as unchanged."""


def driven(surroundings: Surroundings) -> Mask:
    """(n,) Which of those commanded a box may drive onto the paths of lost ones."""
    commanded = np.array(surroundings.commanded)
    return np.zeros_like(commanded) if surroundings.pressed is None else commanded & surroundings.pressed


def yielding(
    allowed_m_s: Array,
    position_m: Array,
    pairs: Pairs,
    surroundings: Surroundings,
    braking: Braking,
) -> Surroundings | None:
    """With what to filter again, as velocities (n, 3) break what is certain; None: with nothing.

    A lost vehicle may take its path, a box that comes on does come. One in front may stop, one behind that is
    not commanded comes on. And vehicles in each other's margin may be too near: driving them apart is not
    worth bringing others nearer.
    """
    again, none = surroundings, np.zeros(len(allowed_m_s), np.bool_)
    about = pairs.first, pairs.second, pairs.other, pairs.normal, pairs.bound_m_s
    if again.goes is not None and np.count_nonzero(again.goes):
        goes = np.array(again.goes)
        held = _held_between(allowed_m_s, pairs.first, pairs.second, pairs.normal, pairs.bound_m_s, goes)
        if np.count_nonzero(held):
            again, rests = replace(again, goes=goes & ~held), ~held[pairs.first]
            first, second, other, normal, bound_m_s = about
            about = first[rests], second[rests], other[rests], normal[rests], bound_m_s[rests]
    if len(again.segments_m):
        pressed = _pressed(allowed_m_s, pairs, position_m, again, braking)
        before = none if again.pressed is None else again.pressed
        if np.count_nonzero(pressed & ~before):
            again = replace(again, pressed=pressed | before)
    nearer = _brought_nearer(allowed_m_s, *about)
    before = none if again.eased is None else again.eased
    if np.count_nonzero(nearer & ~before):
        again = replace(again, eased=nearer | before)
    return None if again is surroundings else again


@kernel
def _held_between(
    allowed_m_s: Array, first: Rows, second: Rows, normal: Array, bound_m_s: Array, goes: Mask
) -> Mask:
    """(n,) Which that go somewhere break, with velocities (n, 3), a bound of one that is not commanded.

    And another one, that is not commanded either, keeps them from holding it.
    """
    held, broken = np.zeros(len(allowed_m_s), np.bool_), np.full(len(allowed_m_s), NO_ROW)
    for k in range(len(first)):
        i, j = first[k], second[k]
        if j == NO_ROW and goes[i] and slack_m_s(allowed_m_s, i, j, normal, bound_m_s, k) < -NOTICEABLE_M_S:
            broken[i] = k
    for k in range(len(first)):
        i, j = first[k], second[k]
        if j != NO_ROW or broken[i] == NO_ROW or held[i]:
            continue
        along = 0.0
        for axis in range(3):
            along += normal[k, axis] * normal[broken[i], axis]
        opposed = along < 0.0
        held[i] = opposed and slack_m_s(allowed_m_s, i, j, normal, bound_m_s, k) < NOTICEABLE_M_S
    return held


@kernel
def _brought_nearer(
    allowed_m_s: Array, first: Rows, second: Rows, other: Rows, normal: Array, bound_m_s: Array
) -> Mask:
    """(n,) Vehicles of pairs (k,) that velocities (n, 3) bring nearer than either may."""
    nearer = np.zeros(len(allowed_m_s), np.bool_)
    for k in range(len(first)):
        slack = slack_m_s(allowed_m_s, first[k], second[k], normal, bound_m_s, k)
        if slack + max(bound_m_s[k], 0.0) < -NOTICEABLE_M_S:
            nearer[first[k]], nearer[other[k]] = True, True
    return nearer


def eased_pairs(pairs: Pairs, position_m: Array, rows: Mask, floor: Floor) -> Pairs:
    """The pairs, where those of `rows` (n,) that are beyond the floor and its margin need not part."""
    away_m = (position_m[pairs.first] - position_m[pairs.other]) * floor.scale
    beyond = np.linalg.norm(away_m, axis=1) >= floor.horizontal_m + floor.margin_m
    rests = (rows[pairs.first] | rows[pairs.other]) & beyond
    return replace(pairs, bound_m_s=np.where(rests, np.minimum(pairs.bound_m_s, 0.0), pairs.bound_m_s))


def _pressed(
    allowed_m_s: Array, pairs: Pairs, position_m: Array, here: Surroundings, braking: Braking
) -> Mask:
    """(n,) Vehicles that velocities (n, 3) would leave before a box that comes on, and those in their way.

    Paths of lost vehicles hold them there. A lost vehicle may take its path, the box comes: it counts first.
    A box that stands, passes or goes away does not.
    """
    pressed = np.zeros(len(allowed_m_s), np.bool_)
    coming = {
        name: each for name, each in here.ellipses.items() if each.velocity_x_m_s or each.velocity_y_m_s
    }
    if not coming:
        return pressed
    at_rest = {name: replace(each, velocity_x_m_s=0.0, velocity_y_m_s=0.0) for name, each in coming.items()}
    boxes, resting = (
        Constraints.joined(*obstacles_around(position_m, replace(here, ellipses=each), braking, np.inf))
        for each in (coming, at_rest)
    )
    comes = boxes.bound_m_s > np.maximum(resting.bound_m_s, 0.0)
    broken = comes & (boxes.slack_m_s(allowed_m_s) < -NOTICEABLE_M_S)
    pressed[boxes.first[broken]] = True
    if broken.any():
        _add_those_in_the_way(pressed, allowed_m_s, pairs, float(boxes.bound_m_s[broken].max()))
    return pressed


def _add_those_in_the_way(pressed: Mask, allowed_m_s: Array, pairs: Pairs, speed_m_s: float) -> None:
    """Add to `pressed` (n,) the vehicles that hinder them, or each other, from flying `speed_m_s` faster."""
    both = pairs.second != NO_ROW
    first, second = pairs.first[both], pairs.second[both]
    closing_m_s = (pairs.normal[both] * (allowed_m_s[first] - allowed_m_s[second])).sum(axis=1)
    near = closing_m_s - pairs.bound_m_s[both] < speed_m_s
    first, second = first[near], second[near]
    before = -1
    while (count := int(np.count_nonzero(pressed))) != before:
        before = count
        pressed[second[pressed[first]]] = True
        pressed[first[pressed[second]]] = True
