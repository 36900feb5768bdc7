"""The safety filter: all constraints, the nearest velocities that keep them, and the reasons."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from math import hypot
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.formation.obstacles import Ellipse
from gcs.model.jit import kernel
from gcs.model.plan import Target
from gcs.model.response import FleetResponse
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import TINY, Array, Mask
from gcs.safety.across_stations import with_reports
from gcs.safety.area_walls import area_constraints
from gcs.safety.authority import AuthoritySettings, reach_constraints
from gcs.safety.constraints import (
    NO_ROW,
    Braking,
    Constraints,
    along_m_s,
    any_broken,
    nearest,
    shortened,
    slack_m_s,
    tightest,
)
from gcs.safety.controlled_ground import ground_constraints, ground_margins
from gcs.safety.fenced_areas import FencedArea, passable, shapes_of
from gcs.safety.floor import Floor, minimum_separation
from gcs.safety.impact import ImpactSettings, reach_of, winds_of
from gcs.safety.lost_paths import OWNERS_MOST, keepout_constraints
from gcs.safety.near_traffic import Evading, NearTraffic, track_constraints
from gcs.safety.neighbours import FEW, Rows, near_pairs
from gcs.safety.separation import Pairs, separation_constraints
from gcs.safety.target_clearance import clearance_constraints
from gcs.safety.traffic import Traffic
from gcs.safety.walls import Fence, fence_constraints, obstacle_constraints

NOTICEABLE_M_S = 0.05

SPARE_M_S = 0.5
"""Pairs are searched as if every velocity could change by this much."""

SOLUTIONS, ATTEMPTS = 3, 6
"""That often the nearest velocities are sought, each time with the pairs that the last ones would bring too
close too, at last with all pairs of up to `FEW` vehicles. After that the velocities are only shortened. If
they still break a constraint of an overlooked pair then, all vehicles brake.
"""

YIELDS = 2
"""That often velocities are filtered at most: once more where constraints contradict each other."""


class Limits(Settings):
    """Limits of every setpoint. A longer vector is scaled; its direction is kept."""

    horizontal_m_s: Positive = 8.0
    """Fastest setpoint sideways, in m/s."""
    up_m_s: Positive = 2.5
    """Fastest setpoint upwards, in m/s."""
    down_m_s: Positive = 1.4
    """Fastest setpoint downwards, in m/s."""

    @property
    def each_m_s(self) -> tuple[float, float, float]:
        """Sideways, of climbing, of descending."""
        return self.horizontal_m_s, self.up_m_s, self.down_m_s

    @property
    def fastest_m_s(self) -> float:
        """In any direction."""
        return hypot(self.horizontal_m_s, max(self.up_m_s, self.down_m_s))


class SafetySettings(Settings):
    """All settings of the safety filter."""

    limits: Limits = Limits()
    """Limits of every setpoint."""
    floor: Floor = Floor()
    """The space around each vehicle that no other may enter, and its margins."""
    fence: Fence = Fence()
    """The volume that no vehicle may leave."""
    impact: ImpactSettings = ImpactSettings()
    """Where vehicles would fall; the fence says where they may (`controlled_ground`)."""
    braking: Braking = Braking()
    """How a vehicle stops."""
    traffic: Traffic = Traffic()
    """How vehicles on their way to a goal pass each other."""
    authority: AuthoritySettings = AuthoritySettings()
    """When a vehicle counts as not reaching its velocity, and what follows."""
    link_delay_s: NotNegative = 0.0
    """Known delay of the links, one way, in s; where a longer one is measured, that one counts."""


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """The fleet and the space around the velocities to be filtered. n rows, show frame."""

    position_m: Array  # (n, 3)
    velocity_m_s: Array  # (n, 3) measured
    commanded: Mask  # (n,)
    airborne: Mask  # (n,) in the air, or possibly so
    descending: Mask  # (n,) descending to land
    segments_m: Array  # (m, 2, 3) paths that lost vehicles may take
    ellipses: Mapping[str, Ellipse]
    names: Sequence[str]
    uncertainty_m: Array  # (n,) standard deviations of the positions, sideways
    speed_max_m_s: Array  # (n,) of each vehicle, in any direction
    lack_m_s: Array  # (n, 3) what the velocities lack of those commanded, lasting
    wander_m: Array  # (n,) standard deviations of where velocities that are not commanded lead
    segments_of: Rows | None = None  # (m,) row of each path's lost vehicle; None: not known
    drift: tuple[Array, Array] | None = None  # (n, 3) positions and velocities of lost ones that still move
    passage: Mask | None = None  # (n,) that keep no margin from `segments_m`, as they would else be enclosed
    response: FleetResponse | None = None  # (n,) in what their stops differ from `braking`; None: in nothing
    drawn: Mask | None = None  # (n,) on trajectories that were drawn for the fleet; None: none of them
    near_traffic: NearTraffic | None = None  # traffic; None: there is none
    shared_m_s: Array | None = None  # (n, 3) what other stations' filters allowed last; NaN, None: not shared
    targets: tuple[Target, ...] = ()  # those with a clearance are kept clear of
    time_s: float = 0.0  # of all these
    goes: Mask | None = None  # (n,) on the way to goals of their own; None: none of them
    low: Mask | None = None  # (n,) do not descend, and may stay below the least height; None: none of them
    pressed: Mask | None = None  # (n,) not held off `segments_m`, as a box comes on; None: none of them
    eased: Mask | None = None  # (n,) that need not part from others beyond the floor; None: none of them

    def over_link(self, delay_s: float) -> "Surroundings":
        """The same when stops begin a round trip of 2 `delay_s` later."""
        if self.response is None or delay_s == 0.0:
            return self
        return replace(self, response=self.response.over_link(delay_s))


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
    reasons: tuple[str, ...] = ()
    for _ in range(YIELDS):
        first = reasons
        allowed_m_s, reasons, again = _filtered(desired_m_s, surroundings, settings)
        if first and surroundings.pressed is not None:
            each = zip(reasons, first, _driven(surroundings).tolist(), strict=True)
            reasons = tuple(now or (before if driven else "") for now, before, driven in each)
        if again is None:
            break
        # onto a path only as fast as the box drives it there
        surroundings, desired_m_s = again, np.where(_driven(again)[:, None], allowed_m_s, desired_m_s)
    return allowed_m_s, reasons


def _driven(surroundings: Surroundings) -> Mask:
    """(n,) Which of those commanded a box may drive onto the paths of lost ones."""
    commanded = np.array(surroundings.commanded)
    return np.zeros_like(commanded) if surroundings.pressed is None else commanded & surroundings.pressed


def _filtered(
    desired_m_s: Array, surroundings: Surroundings, settings: SafetySettings
) -> tuple[Array, tuple[str, ...], Surroundings | None]:
    """Velocities and reasons as of `filter_velocities`, and with what to filter again; None: with nothing.

    Constraints that contradict each other are all broken a little. Then the less certain ones have to yield.
    """
    here, limits = surroundings.over_link(settings.link_delay_s), settings.limits
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
    desired_m_s = cap(desired_m_s, limits, here.speed_max_m_s)
    if moved is not own:
        here = replace(here, commanded=moved)
    pairs_of = _pairs_of(position_m, desired_m_s, own, here, settings.floor, braking)
    pairs, involved = _first_pairs(pairs_of, desired_m_s, own, here)
    confined = here if involved is moved else replace(here, commanded=involved)
    walls_of = partial(_walls, position_m, desired_m_s, confined, settings, braking)
    course_m_s = None if settings.fence.is_plain else _lengths(desired_m_s, np.zeros_like(desired_m_s))
    walls = walls_of(course_m_s)
    walls = Constraints.joined(walls, _reach(here, walls, settings))
    landing = np.array(here.descending) & (not settings.fence.is_plain)
    allowed_m_s = searched_m_s = desired_m_s
    for attempt in range(ATTEMPTS):
        judged, joined = walls, _joined(walls, pairs)
        if attempt < SOLUTIONS:
            allowed_m_s = cap(nearest(desired_m_s, *joined), limits, here.speed_max_m_s, landing)
        allowed_m_s = shortened(allowed_m_s, *joined, landing)
        strays = (_lengths(searched_m_s, allowed_m_s) > SPARE_M_S) & involved
        if not np.count_nonzero(strays):
            break  # every change is within the searched range
        searched_m_s = np.where(strays[:, None], allowed_m_s, searched_m_s)
        every = attempt == SOLUTIONS - 2 and len(position_m) <= FEW
        spare_m_s = np.full(len(own), 2.0 * limits.fastest_m_s if every else SPARE_M_S)
        near = pairs_of(course_m_s=searched_m_s, spare_m_s=spare_m_s, only=None if every else strays)
        overlooked = with_reports(near.not_in(pairs, len(position_m)), own, here.shared_m_s)
        farther = Constraints.none() if settings.fence.is_plain else walls_of(None, only=strays)
        if not any_broken(allowed_m_s, *_joined(farther, overlooked)):
            break
        pairs, walls = pairs.joined(overlooked), Constraints.joined(walls, farther)
    else:
        allowed_m_s = np.zeros_like(allowed_m_s)
    again = _yielding(allowed_m_s, position_m, pairs, surroundings, braking)
    changed_m_s = _lengths(desired_m_s, allowed_m_s)
    if not settings.fence.is_plain and len(judged):
        _raise_to_unmet(changed_m_s, allowed_m_s, judged.first, judged.normal, judged.bound_m_s)
    if moved is not own:
        allowed_m_s[~own], changed_m_s[~own] = 0.0, 0.0
    return allowed_m_s, _reasons(desired_m_s, changed_m_s, judged, pairs, joined, here.names), again


def _yielding(
    allowed_m_s: Array,
    position_m: Array,
    pairs: Pairs,
    surroundings: Surroundings,
    braking: Braking,
) -> Surroundings | None:
    """With what to filter again, as velocities (n, 3) break what is certain; None: with nothing.

    A lost vehicle may take its path, a box that comes on does come. And vehicles in each other's margin may
    be too near: driving them apart is not worth bringing others nearer.
    """
    again, none = surroundings, np.zeros(len(allowed_m_s), np.bool_)
    if len(again.segments_m):
        pressed = _pressed(allowed_m_s, pairs, position_m, again, braking)
        before = none if again.pressed is None else again.pressed
        if np.count_nonzero(pressed & ~before):
            again = replace(again, pressed=pressed | before)
    about = pairs.first, pairs.second, pairs.other, pairs.normal, pairs.bound_m_s
    nearer = _brought_nearer(allowed_m_s, *about)
    before = none if again.eased is None else again.eased
    if np.count_nonzero(nearer & ~before):
        again = replace(again, eased=nearer | before)
    return None if again is surroundings else again


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


def _eased(pairs: Pairs, position_m: Array, rows: Mask, floor: Floor) -> Pairs:
    """The pairs, where those of `rows` (n,) that are beyond the floor and its margin need not part."""
    away_m = (position_m[pairs.first] - position_m[pairs.other]) * floor.scale
    beyond = np.linalg.norm(away_m, axis=1) >= floor.horizontal_m + floor.margin_m
    eased = (rows[pairs.first] | rows[pairs.other]) & beyond
    return replace(pairs, bound_m_s=np.where(eased, np.minimum(pairs.bound_m_s, 0.0), pairs.bound_m_s))


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
        Constraints.joined(*_obstacles(position_m, replace(here, ellipses=each), braking, np.inf))
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
    one, other = pairs.first[both], pairs.second[both]
    closing_m_s = (pairs.normal[both] * (allowed_m_s[one] - allowed_m_s[other])).sum(axis=1)
    near = closing_m_s - pairs.bound_m_s[both] < speed_m_s
    one, other = one[near], other[near]
    before = -1
    while (count := int(np.count_nonzero(pressed))) != before:
        before = count
        pressed[other[pressed[one]]] = True
        pressed[one[pressed[other]]] = True


def _first_pairs(
    pairs_of: Callable[..., Pairs], desired_m_s: Array, own: Mask, here: Surroundings
) -> tuple[Pairs, Mask]:
    """Pairs of the `own` (n,) commanded vehicles, of their neighbours of other stations, and of theirs.

    Two stations project the velocities of a pair alike, and each sends its own. So both must know what else
    keeps either vehicle from giving way.

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
    return with_reports(pairs, own, here.shared_m_s), involved


def _pairs_of(
    position_m: Array, desired_m_s: Array, own: Mask, here: Surroundings, floor: Floor, braking: Braking
) -> Callable[..., Pairs]:
    """Return a function that finds pairs too close if both differ from `course_m_s` by `spare_m_s`."""
    search = partial(
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
    eased = here.eased
    return search if eased is None else lambda **given: _eased(search(**given), position_m, eased, floor)


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


def _walls(
    position_m: Array,
    desired_m_s: Array,
    here: Surroundings,
    settings: SafetySettings,
    braking: Braking,
    speed_m_s: Array | None,
    only: Mask | None = None,
) -> Constraints:
    """All constraints on single vehicles: paths of lost ones, fence, ground, obstacles, target, traffic.

    Areas and ground are left out where no velocity breaks them that is by `SPARE_M_S` faster than `speed_m_s`
    (n,); None: no limit of the vehicles is. With `only` (n,) there are areas and ground alone, of these rows.
    """
    course_m_s = None if speed_m_s is None else speed_m_s + SPARE_M_S
    if only is not None:
        confined = replace(here, commanded=here.commanded & only)
        return _site(position_m, confined, settings, braking, course_m_s)
    fastest_m_s = settings.limits.fastest_m_s
    fence = fence_constraints(
        position_m,
        here.commanded,
        here.descending if here.low is None else here.descending | here.low,
        settings.fence,
        braking,
        velocity_m_s=here.velocity_m_s,
        standoff_m=settings.floor.standoff_m(np.array(here.uncertainty_m)),
        response=here.response,
        fastest_m_s=fastest_m_s,
    )
    site = _site(position_m, here, settings, braking, course_m_s)
    clear_of_targets = (
        clearance_constraints(
            position_m,
            here.velocity_m_s,
            here.commanded,
            target,
            here.time_s + settings.link_delay_s,
            floor=settings.floor,
            braking=braking,
            uncertainty_m=here.uncertainty_m,
            response=here.response,
            fastest_m_s=fastest_m_s,
        )
        for target in here.targets
        if target.clearance_m
    )
    walls = Constraints.joined(
        _lost(position_m, here, settings, braking),
        fence,
        site,
        *_obstacles(position_m, here, braking, fastest_m_s),
        *clear_of_targets,
    )
    if here.near_traffic is None:
        return walls
    evading = Evading(
        position_m,
        here.commanded & ~here.descending,
        desired_m_s,
        settings.floor.standoff_m(np.array(here.uncertainty_m)),
        np.minimum(here.speed_max_m_s, settings.limits.horizontal_m_s),
        braking.of_each(len(position_m), here.response),
        settings.fence.distance_max_m,
    )
    return Constraints.joined(walls, track_constraints(evading, here.near_traffic))


def _lost(position_m: Array, here: Surroundings, settings: SafetySettings, braking: Braking) -> Constraints:
    """Constraints of the paths that lost vehicles may take."""
    if not len(here.segments_m):
        return Constraints.none()
    return keepout_constraints(
        position_m,
        here.commanded if here.pressed is None else here.commanded & ~here.pressed,
        here.segments_m,
        floor=settings.floor,
        braking=braking,
        uncertainty_m=np.hypot(here.uncertainty_m, here.wander_m),
        segments_uncertainty_m=None if here.segments_of is None else here.uncertainty_m[here.segments_of],
        segments_of=here.segments_of,
        drift=here.drift,
        passage=here.passage,
        response=here.response,
        fastest_m_s=settings.limits.fastest_m_s,
    )


def _obstacles(
    position_m: Array, here: Surroundings, braking: Braking, fastest_m_s: float
) -> tuple[Constraints, Constraints]:
    """Constraints of obstacles, and of slow traffic, which holds up no vehicle that lands."""
    if not here.ellipses:
        return Constraints.none(), Constraints.none()
    slow = set() if here.near_traffic is None else {box.id for box in here.near_traffic.boxes}

    def around(is_slow: bool, commanded: Mask) -> Constraints:
        ellipses = {name: here.ellipses[name] for name in here.ellipses if (name in slow) is is_slow}
        return obstacle_constraints(
            position_m, commanded, ellipses, braking, response=here.response, fastest_m_s=fastest_m_s
        )

    return around(False, here.commanded), around(True, here.commanded & ~here.descending)


def _site(
    position_m: Array,
    here: Surroundings,
    settings: SafetySettings,
    braking: Braking,
    course_m_s: Array | None,
) -> Constraints:
    """Constraints of the fence's areas, and of where vehicles would fall."""
    fence, ground = settings.fence, settings.fence.controlled_ground
    if fence.is_plain:
        return Constraints.none()
    velocity_m_s = np.nan_to_num(here.velocity_m_s)
    uncertainty_m = np.array(here.uncertainty_m)
    fastest_m_s = settings.limits.fastest_m_s
    walls = area_constraints(
        position_m,
        here.commanded,
        fence.areas,
        braking,
        velocity_m_s=velocity_m_s,
        standoff_m=settings.floor.off_walls_m(uncertainty_m),
        response=here.response,
        fastest_m_s=fastest_m_s,
        descending=here.descending,
        heights_m=fence.heights_m,
        course_m_s=course_m_s,
    )
    if ground is None:
        return walls
    falls = ground_constraints(
        position_m,
        here.commanded,
        ground,
        settings.impact,
        braking,
        velocity_m_s=velocity_m_s,
        standoff_m=settings.floor.standoff_m(uncertainty_m),
        response=here.response,
        fastest_m_s=fastest_m_s,
        course_m_s=course_m_s,
    )
    return Constraints.joined(walls, falls)


def _reach(here: Surroundings, walls: Constraints, settings: SafetySettings) -> Constraints:
    """Constraints on what vehicles short of authority cannot do."""
    least = settings.authority
    return reach_constraints(
        np.array(here.velocity_m_s),
        np.array(here.commanded),
        here.lack_m_s,
        walls,
        least.lack_m_s,
        least.reserve_m_s,
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
