"""The safety filter: all constraints, the nearest velocities that keep them, and the reasons."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel
from gcs.model.state import TINY, Array, Mask
from gcs.safety.across_stations import with_reports
from gcs.safety.area_walls import area_constraints
from gcs.safety.constraints import (
    NO_ROW,
    Braking,
    Constraints,
    along_m_s,
    any_broken,
    nearest,
    shortened,
    tightest,
)
from gcs.safety.controlled_ground import ground_constraints, ground_margins
from gcs.safety.fenced_areas import FencedArea, passable, shapes_of
from gcs.safety.floor import Floor, minimum_separation
from gcs.safety.impact import reach_of, winds_of
from gcs.safety.lost_paths import OWNERS_MOST, keepout_constraints
from gcs.safety.neighbours import FEW, Rows, near_pairs
from gcs.safety.separation import Pairs, separation_constraints
from gcs.safety.surroundings import Limits, SafetySettings, Surroundings
from gcs.safety.walls_of_each import SPARE_M_S, reach_of_each, walls_of_each
from gcs.safety.yielding import NOTICEABLE_M_S, driven, eased_pairs, yielding

SOLUTIONS, ATTEMPTS = 3, 6
"""That often the nearest velocities are sought, each time with the pairs that the last ones would bring too
close too, at last with all pairs of up to `FEW` vehicles. After that the velocities are only shortened. If
they still break a constraint of an overlooked pair then, all vehicles brake.
"""

YIELDS = 2
"""That often velocities are filtered at most: once more where constraints contradict each other."""


def filter_velocities(
    desired_m_s: Array, surroundings: Surroundings, settings: SafetySettings
) -> tuple[Array, tuple[str, ...]]:
    """Bring the desired velocities within every limit and constraint.

    Args:
        desired_m_s: (n, 3), show frame; rows not finite become rest, rows neither commanded nor shared are
            ignored.
        surroundings: the same n rows.
        settings: limits and margins.

    Returns: (n, 3) in m/s, and for each row why it was limited, "" when it was not. Rest where not commanded.
    """
    before: tuple[str, ...] = ()
    begun: Begun | None = None
    for left in reversed(range(YIELDS)):
        begun = begun or _begun(desired_m_s, surroundings, settings)
        allowed_m_s, reasons_of, again = _filtered(begun, surroundings, settings)
        if again is None or left == 0:
            break
        if again.pressed is not None:  # onto a path only as fast as the box drives it there
            before, begun = reasons_of(), None
            desired_m_s = np.where(driven(again)[:, None], allowed_m_s, desired_m_s)
        elif again.goes is not surroundings.goes:
            begun = None
        surroundings = again
    reasons = reasons_of()
    if before and surroundings.pressed is not None:
        each = zip(reasons, before, driven(surroundings).tolist(), strict=True)
        reasons = tuple(now or (then if driven else "") for now, then, driven in each)
    return allowed_m_s, reasons


@dataclass(frozen=True, slots=True, eq=False)
class Begun:
    """What is known before velocities are sought, however often that is, unless others are desired."""

    position_m: Array  # (n, 3) when setpoints arrive
    desired_m_s: Array  # (n, 3) within the limits, rest where nothing is commanded
    own: Mask  # (n,) commanded by this station
    here: Surroundings  # with those as commanded as well that other stations share
    braking: Braking
    pairs: Pairs  # that `desired_m_s` could bring too close
    involved: Mask  # (n,) as of `_first_pairs`
    walls_of: Callable[..., Constraints]  # `walls_of_each` for a speed (n,), and only some rows
    walls: Constraints  # of each vehicle alone


def _begun(desired_m_s: Array, surroundings: Surroundings, settings: SafetySettings) -> Begun:
    here = surroundings.over_link(settings.link_delay_s)
    braking = settings.braking.over_link(settings.link_delay_s)
    own = np.array(here.commanded)
    moved = own if here.shared_m_s is None else own | np.isfinite(here.shared_m_s[:, 0])
    position_m, desired_m_s = _later_and_only(
        np.array(here.position_m),
        np.array(here.velocity_m_s),
        np.array(desired_m_s),
        moved,
        settings.link_delay_s,
    )
    desired_m_s = cap(desired_m_s, settings.limits, here.speed_max_m_s)
    if moved is not own:
        here = replace(here, commanded=moved)
    pairs_of = _pairs_of(position_m, desired_m_s, own, here, settings.floor, braking)
    pairs, involved = _first_pairs(pairs_of, desired_m_s, own, here)
    confined = here if involved is moved else replace(here, commanded=involved)
    walls_of = partial(walls_of_each, position_m, desired_m_s, confined, settings, braking)
    walls = walls_of(None if settings.fence.is_plain else _lengths(desired_m_s, np.zeros_like(desired_m_s)))
    walls = Constraints.joined(walls, reach_of_each(here, walls, settings))
    return Begun(position_m, desired_m_s, own, here, braking, pairs, involved, walls_of, walls)


def _filtered(
    begun: Begun, surroundings: Surroundings, settings: SafetySettings
) -> tuple[Array, Callable[[], tuple[str, ...]], Surroundings | None]:
    """Velocities and reasons as of `filter_velocities`, and with what to filter again; None: with nothing.

    Constraints that contradict each other are all broken a little. Then the less certain ones have to yield.
    """
    desired_m_s, own, here, limits = begun.desired_m_s, begun.own, begun.here, settings.limits
    position_m, eased = begun.position_m, surroundings.eased

    def as_they_count(pairs: Pairs) -> Pairs:
        pairs = pairs if eased is None else eased_pairs(pairs, position_m, eased, settings.floor)
        return pairs if here.shared_m_s is None else with_reports(pairs, own, here.shared_m_s)

    pairs_of = _pairs_of(position_m, desired_m_s, own, here, settings.floor, begun.braking)
    pairs, walls = as_they_count(begun.pairs), begun.walls
    landing = np.array(here.descending) & (not settings.fence.is_plain)
    allowed_m_s = searched_m_s = desired_m_s
    for attempt in range(ATTEMPTS):
        judged, joined = walls, _joined(walls, pairs)
        if attempt < SOLUTIONS:
            allowed_m_s = cap(nearest(desired_m_s, *joined), limits, here.speed_max_m_s, landing)
        allowed_m_s = shortened(allowed_m_s, *joined, landing)
        strays = (_lengths(searched_m_s, allowed_m_s) > SPARE_M_S) & begun.involved
        if not np.count_nonzero(strays):
            break  # every change is within the searched range
        searched_m_s = np.where(strays[:, None], allowed_m_s, searched_m_s)
        every = attempt == SOLUTIONS - 2 and len(position_m) <= FEW
        spare_m_s = np.full(len(own), 2.0 * limits.fastest_m_s if every else SPARE_M_S)
        near = pairs_of(course_m_s=searched_m_s, spare_m_s=spare_m_s, only=None if every else strays)
        overlooked = as_they_count(near.not_in(pairs, len(position_m)))
        farther = Constraints.none() if settings.fence.is_plain else begun.walls_of(None, only=strays)
        if not any_broken(allowed_m_s, *_joined(farther, overlooked)):
            break
        pairs, walls = pairs.joined(overlooked), Constraints.joined(walls, farther)
    else:
        allowed_m_s = np.zeros_like(allowed_m_s)
    again = yielding(allowed_m_s, position_m, pairs, surroundings, begun.braking)
    changed_m_s = _lengths(desired_m_s, allowed_m_s)
    if not settings.fence.is_plain and len(judged):
        _raise_to_unmet(changed_m_s, allowed_m_s, judged.first, judged.normal, judged.bound_m_s)
    if here.shared_m_s is not None:
        allowed_m_s[~own], changed_m_s[~own] = 0.0, 0.0
    reasons_of = partial(_reasons, desired_m_s, changed_m_s, judged, pairs, joined, here.names)
    return allowed_m_s, reasons_of, again


def _first_pairs(
    pairs_of: Callable[..., Pairs], desired_m_s: Array, own: Mask, here: Surroundings
) -> tuple[Pairs, Mask]:
    """Pairs of the `own` (n,) commanded vehicles, of their neighbours of other stations, and of theirs.

    Two stations project the velocities of a pair alike, and each sends its own. So both must know what else
    keeps either vehicle from giving way. What other stations report of their vehicles is not among them.

    Returns: the pairs, and (n,) the own vehicles and those neighbours.
    """
    desired = {"course_m_s": desired_m_s, "spare_m_s": np.full(len(own), SPARE_M_S)}
    if here.shared_m_s is None:
        return pairs_of(**desired), own
    pairs = pairs_of(**desired, only=own)
    involved = own.copy()
    involved[pairs.first] = True
    involved[pairs.other] |= here.commanded[pairs.other]
    neighbours = involved & ~own
    if neighbours.any():
        of_neighbours = pairs_of(**desired, only=neighbours)
        pairs = pairs.joined(of_neighbours.not_in(pairs, len(own)))
    return pairs, involved


def _pairs_of(
    position_m: Array, desired_m_s: Array, own: Mask, here: Surroundings, floor: Floor, braking: Braking
) -> Callable[..., Pairs]:
    """Return a function that finds pairs too close if both differ from `course_m_s` by `spare_m_s`."""
    return partial(
        separation_constraints,
        position_m,
        here.velocity_m_s,
        here.commanded,
        here.airborne,
        floor=floor,
        braking=braking,
        uncertainty_m=here.uncertainty_m,
        wander_m=here.wander_m,
        drawn=None if here.drawn is None else here.drawn & own,
        desired_m_s=desired_m_s,
        response=here.response,
        low_counts=own & ~here.descending,
        goes=here.goes,
    )


@kernel
def _later_and_only(
    position_m: Array, velocity_m_s: Array, desired_m_s: Array, commanded: Mask, delay_s: float
) -> tuple[Array, Array]:
    """(n, 3) positions `delay_s` later, and (n, 3) desired velocities with rest where not commanded.

    A row without a finite velocity stays.
    """
    later_m, kept_m_s = position_m.copy(), np.zeros_like(desired_m_s)
    for i in range(len(position_m)):
        for axis in range(3):
            if np.isfinite(velocity_m_s[i, axis]):
                later_m[i, axis] += delay_s * velocity_m_s[i, axis]
            if commanded[i]:
                kept_m_s[i, axis] = desired_m_s[i, axis]
    return later_m, kept_m_s


@kernel
def _lengths(before_m_s: Array, after_m_s: Array) -> Array:
    """(n,) lengths of the changes from (n, 3) to (n, 3)."""
    length_m_s = np.empty(len(before_m_s))
    for i in range(len(before_m_s)):
        square = 0.0
        for axis in range(3):
            square += (after_m_s[i, axis] - before_m_s[i, axis]) ** 2
        length_m_s[i] = np.sqrt(square)
    return length_m_s


@kernel
def _raise_to_unmet(
    changed_m_s: Array, allowed_m_s: Array, first: Rows, normal: Array, bound_m_s: Array
) -> None:
    """Raise changes (n,) to what velocities (n, 3) lack of the walls (k,): not led as these demand."""
    for k in range(len(first)):
        i = first[k]
        changed_m_s[i] = max(changed_m_s[i], bound_m_s[k] - along_m_s(allowed_m_s, i, normal, k))


Joined: TypeAlias = tuple[Rows, Rows, Array, Array]
"""Rows (k,), rows or NO_ROW (k,), normals (k, 3) and bounds (k,): the walls first, then the pairs."""


def _joined(walls: Constraints, pairs: Pairs) -> Joined:
    if len(walls) == 0:
        return pairs.first, pairs.second, pairs.normal, pairs.bound_m_s
    return (
        np.concatenate([walls.first, pairs.first]),
        np.concatenate([walls.second, pairs.second]),
        np.concatenate([walls.normal, pairs.normal]),
        np.concatenate([walls.bound_m_s, pairs.bound_m_s]),
    )


def cap(
    velocity_m_s: Array,
    limits: Limits,
    speed_max_m_s: Array | float = np.inf,
    landing: Mask | None = None,
) -> Array:
    """(n, 3) within the limits and each vehicle's own speed (n,): long rows shortened; not finite: rest.

    Rows of `landing` (n,) keep their descent, and only their level part is shortened; None: none does.
    """
    is_each = isinstance(speed_max_m_s, np.ndarray)
    return _capped(
        np.array(velocity_m_s),
        np.array(speed_max_m_s) if is_each else np.full(len(velocity_m_s), speed_max_m_s),
        np.zeros(len(velocity_m_s), np.bool_) if landing is None else landing,
        limits.horizontal_m_s,
        limits.up_m_s,
        limits.down_m_s,
    )


@kernel
def _capped(
    velocity_m_s: Array,
    own_m_s: Array,
    landing: Mask,
    horizontal_m_s: float,
    up_m_s: float,
    down_m_s: float,
) -> Array:
    """As `cap`, for (n, 3) and (n,)."""
    capped = np.zeros_like(velocity_m_s)
    for i in range(len(velocity_m_s)):
        x, y, z = velocity_m_s[i, 0], velocity_m_s[i, 1], velocity_m_s[i, 2]
        if not (np.isfinite(x) and np.isfinite(y) and np.isfinite(z)):
            continue
        if landing[i] and z > 0.0:
            z = min(z, down_m_s, own_m_s[i])
            left_m_s = min(np.sqrt(own_m_s[i] ** 2 - z * z), horizontal_m_s)
            share = min(1.0, left_m_s / max(np.sqrt(x * x + y * y), TINY))
            capped[i, 0], capped[i, 1], capped[i, 2] = share * x, share * y, z
            continue
        share = min(1.0, own_m_s[i] / max(np.sqrt(x * x + y * y + z * z), TINY))
        share = min(share, horizontal_m_s / max(np.sqrt(x * x + y * y), TINY))
        share = min(share, (up_m_s if z < 0.0 else down_m_s) / max(abs(z), TINY))
        capped[i, 0], capped[i, 1], capped[i, 2] = share * x, share * y, share * z
    return capped


def _reasons(
    desired_m_s: Array,
    changed_m_s: Array,
    walls: Constraints,
    pairs: Pairs,
    joined: Joined,
    names: Sequence[str],
) -> tuple[str, ...]:
    """For each row that was changed noticeably: the constraint that the desired velocity broke most.

    A row that broke none was pushed by others: the constraint that it came nearest to breaking.
    """
    if not np.count_nonzero(changed_m_s > NOTICEABLE_M_S):
        return ("",) * len(desired_m_s)
    texts = _texts(tuple(names))
    if len(walls):
        texts = np.concatenate([texts, walls.reason])
    which = tightest(desired_m_s, *joined)
    causes = _causes(changed_m_s, which, joined[0], pairs.other, len(walls))
    return tuple(texts[causes].tolist())


@kernel
def _causes(changed_m_s: Array, which: Rows, first: Rows, other: Rows, walls: int) -> Rows:
    """(n,) the place of each row's reason among `_texts` and the reasons of the walls after them.

    Args:
        changed_m_s: (n,) by how much the filter changed each velocity.
        which: (n,) the tightest constraint of each row, or NO_ROW.
        first: (k,) row i of each constraint: of the walls, then of the pairs.
        other: row j of each of the pairs.
        walls: number of the walls.
    """
    n = len(changed_m_s)
    causes = np.full(n, n)
    for i in range(n):
        if not changed_m_s[i] > NOTICEABLE_M_S:
            continue
        k = which[i]
        if k == NO_ROW:
            causes[i] = n + 1
        elif k < walls:
            causes[i] = n + 2 + k
        else:
            causes[i] = other[k - walls] if first[k] == i else first[k]
    return causes


@lru_cache(maxsize=64)
def _texts(names: tuple[str, ...]) -> NDArray[np.object_]:
    """(n + 2,) the reasons: keeping away from each vehicle, none, the limits."""
    return np.array([*(f"separation from {name}" for name in names), "", "limits"], dtype=object)


def prepare(settings: SafetySettings) -> None:
    """Make the tables of a site, so that none is made in flight: that takes up to a second."""
    fence, impact = settings.fence, settings.impact
    shapes_of(passable(fence.areas, fence.heights_m))
    if fence.controlled_ground is not None:
        shapes_of((fence.controlled_ground,))
        for wind_m_s in winds_of(impact):  # that may be measured
            reach_of(impact.falling, wind_m_s)


def warm_up() -> None:
    """Run the kernels that few ticks reach: velocities that change far more than expected, the separation."""
    position_m = np.array([[0.0, 0.0, -20.0], [2.5, 0.0, -20.0], [40.0, 0.0, -20.0]])
    velocity_m_s, zero, all_rows = np.zeros((3, 3)), np.zeros(3), np.ones(3, dtype=bool)
    here = Surroundings(
        position_m,
        velocity_m_s,
        all_rows,
        all_rows,
        ~all_rows,
        np.zeros((0, 2, 3)),
        {},
        ("a", "b", "c"),
        zero,
        zero,
        velocity_m_s,
        zero,
    )
    settings = SafetySettings()
    own, shared = np.array([True, False, True]), replace(here, shared_m_s=velocity_m_s)
    pairs_of = _pairs_of(position_m, velocity_m_s, all_rows, here, settings.floor, settings.braking)
    pairs, _ = _first_pairs(pairs_of, velocity_m_s, own, shared)
    pairs = with_reports(pairs, own, velocity_m_s)
    any_broken(velocity_m_s, *_joined(Constraints.none(), pairs))
    columns_m = np.array([[[x_m, 0.0, -20.0], [x_m, 0.0, 0.0]] for x_m in (-1.0, 1.0)])
    keepout_constraints(
        position_m,
        all_rows,
        columns_m,
        floor=settings.floor,
        braking=settings.braking,
        uncertainty_m=zero,
    )
    keepout_constraints(
        position_m,
        all_rows,
        np.repeat(columns_m, OWNERS_MOST, axis=0),
        floor=settings.floor,
        braking=settings.braking,
        uncertainty_m=zero,
        segments_of=np.arange(2 * OWNERS_MOST),
    )
    minimum_separation(position_m, all_rows, settings.floor)
    near_pairs(all_rows, position_m, all_rows, zero)
    ring = FencedArea(corners_m=((0.0, 0.0), (9.0, 0.0), (0.0, 9.0)))
    braking, impact = settings.braking, settings.impact
    both = ring, ring.model_copy(update={"inside": False})  # each vehicle is on the wrong side of one
    area_constraints(position_m, all_rows, both, braking, velocity_m_s=velocity_m_s, standoff_m=zero)
    ground_constraints(
        position_m, all_rows, ring, impact, braking, velocity_m_s=velocity_m_s, standoff_m=zero
    )
    ground_margins(position_m, velocity_m_s, ring, settings.impact)
