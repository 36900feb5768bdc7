"""When which reaction is wanted: pure, for the whole fleet at once.

A cause begins when it has held for a while, and ends when it has been gone for `clear_s`: nothing flaps.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gcs.reactions import SEVERITY, Action, Cause, ReactionSettings
from gcs.safety.walls import Fence
from gcs.state import Array, Mask

LOST, LOW, CRITICAL, POOR, SUDDEN, OUT, BELOW = range(7)
"""Rows of what can befall one vehicle."""

OF_VEHICLES: Final = (
    Cause.VEHICLE_LOST,
    Cause.LOW_BATTERY,
    Cause.CRITICAL_BATTERY,
    Cause.BAD_POSITION,
    Cause.BAD_POSITION,
    Cause.FENCE,
    Cause.FENCE,
)

OF_THE_SHOW: Final = (Cause.WIND, Cause.VEHICLES_LOST, Cause.TARGET_STALE, Cause.SERVICE_LATE)

AT_ONCE_S = 0.3
"""Who has no position to believe is not commanded, and its autopilot notices that within a second."""

SMOOTH_S = 1.0
"""Time constant with which errors of velocity and lateness are averaged."""

LATENESS_COUNTS: Final = 4.0
"""One tick counts for at most this many times the limit: a single long stall is over when it is over."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What the rules look at, in one tick. Rows as in FleetState; NaN where nothing is known."""

    time_s: float
    position_m: Array  # (n, 3) show frame
    velocity_m_s: Array  # (n, 3)
    wanted_m_s: Array  # (n, 3) that each should have had, NaN: not commanded
    battery: Array  # (n,) 0 to 1
    horizontal_m: Array  # (n,) accuracy as reported
    vertical_m: Array  # (n,)
    unbelieved: Mask  # (n,) heard lately, but at an impossible place
    silent: Mask  # (n,) not heard lately
    reset_time_s: Array  # (n,) when the position last jumped, -inf: never
    fence: Fence
    target_age_s: float  # since a live target was told; NaN: there is none
    late_s: float  # by which the newest tick was late


@dataclass(frozen=True, slots=True, eq=False)
class Roles:
    """Who is what, for those causes that befall somebody. Rows as in FleetState."""

    flying: Mask  # (n,) in the air, and ours
    formed: Mask  # (n,) of these in formation
    lost: Mask  # (n,) were ours when they fell silent, or were killed
    paused_s: float  # for how long the show has been paused


@dataclass(frozen=True, slots=True, eq=False)
class Latch:
    """Conditions, (k, m), that begin when they have held for a while and end when they are gone for one."""

    on_since_s: Array  # (k, m) NaN: does not hold now
    last_on_s: Array  # (k, m) when it held last
    since_s: Array  # (k, m) active since then, NaN: not active

    @staticmethod
    def idle(causes: int, count: int) -> "Latch":
        """Nothing has ever held."""
        never = np.full((causes, count), np.nan)
        return Latch(never, np.full((causes, count), -np.inf), never)

    @property
    def active(self) -> Mask:
        """(k, m)."""
        return ~np.isnan(self.since_s)

    @property
    def is_idle(self) -> bool:
        """Whether nothing holds, nor is active: a tick in which nothing holds would change nothing."""
        return bool(np.isnan(self.on_since_s).all() and np.isnan(self.since_s).all())

    def next(self, on: Mask, now_s: float, for_s: Array, clear_s: float) -> "Latch":
        """After a tick in which `on` (k, m) held; `for_s` (k, 1) says how long each must."""
        on_since_s = np.where(on, np.fmin(self.on_since_s, now_s), np.nan)
        last_on_s = np.where(on, now_s, self.last_on_s)
        begins = on & (now_s - on_since_s >= for_s)
        goes_on = self.active & (now_s - last_on_s < clear_s)
        since_s = np.where(begins | goes_on, np.fmin(self.since_s, now_s), np.nan)
        return Latch(on_since_s, last_on_s, since_s)


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """All that one tick's rules hand to the next. Owns its arrays."""

    time_s: float
    error_m_s: Array  # (n, 2) flown minus wanted, averaged
    late_s: float  # averaged
    jumps_s: Array  # (j, n) the last jumps of each position, oldest first
    vehicles: Latch  # (7, n)
    show: Latch  # (4, 1)

    @staticmethod
    def nothing(count: int, now_s: float, settings: ReactionSettings) -> "Known":
        """At the beginning."""
        jumps_s = np.full((settings.bad_position.jumps, count), -np.inf)
        vehicles, show = Latch.idle(len(OF_VEHICLES), count), Latch.idle(len(OF_THE_SHOW), 1)
        return Known(now_s, np.zeros((count, 2)), 0.0, jumps_s, vehicles, show)


@dataclass(frozen=True, slots=True)
class Wish:
    """One reaction that is wanted, for as long as its cause lasts."""

    cause: Cause
    action: Action
    since_s: float
    rows: tuple[int, ...]  # whom it concerns; empty: nobody in particular
    whole_show: bool  # whether the action is the show's
    reason: str

    @property
    def severity(self) -> int:
        """See SEVERITY."""
        return SEVERITY[self.action]


def look(seen: Seen, known: Known, settings: ReactionSettings) -> tuple[Known, Mask, bool]:
    """What happens to whom, as far as telemetry alone tells it; cheap, once a tick.

    Returns: averages brought up to date; (7, n) what would befall whoever flies (see OF_VEHICLES); and
    whether the wind is too strong.
    """
    dt_s = max(seen.time_s - known.time_s, 0.0)
    share = min(1.0, dt_s / SMOOTH_S)
    error_m_s = seen.velocity_m_s[:, :2] - seen.wanted_m_s[:, :2]
    commanded: Mask = np.asarray(np.isfinite(error_m_s).all(axis=1))
    error_m_s = np.where(commanded[:, None], error_m_s, 0.0)
    error_m_s = known.error_m_s + share * (error_m_s - known.error_m_s)
    error_m_s[~commanded] = 0.0
    late_s = min(seen.late_s, LATENESS_COUNTS * settings.service_late.late_s)
    late_s = known.late_s + share * (late_s - known.late_s)
    jumped = seen.reset_time_s > known.jumps_s[-1]
    jumps_s = known.jumps_s
    if jumped.any():
        jumps_s = np.where(jumped, np.vstack([jumps_s[1:], seen.reset_time_s]), jumps_s)
    wind = settings.wind
    strays = np.hypot(error_m_s[:, 0], error_m_s[:, 1]) > wind.speed_error_m_s
    too_windy = bool(strays.any() and strays.sum() >= wind.share * commanded.sum())
    averages = replace(known, time_s=seen.time_s, error_m_s=error_m_s, late_s=late_s, jumps_s=jumps_s)
    return averages, _conditions(seen, jumps_s, commanded, settings), too_windy


def _conditions(seen: Seen, jumps_s: Array, commanded: Mask, settings: ReactionSettings) -> Mask:
    """(7, n), see OF_VEHICLES; whoever is not in the air is not left out yet."""
    position, battery = settings.bad_position, settings.low_battery
    on = np.zeros((len(OF_VEHICLES), len(seen.battery)), dtype=np.bool_)
    on[LOST] = seen.silent
    on[LOW] = seen.battery < battery.below  # False for NaN
    on[CRITICAL] = seen.battery < battery.critical_below
    on[POOR] = (seen.horizontal_m > position.horizontal_max_m) | (seen.vertical_m > position.vertical_max_m)
    on[SUDDEN] = seen.unbelieved | (seen.time_s - jumps_s[0] <= position.jumps_within_s)
    out_m, below_m = _beyond_m(seen, settings.fence.within_s)
    on[OUT] = out_m > settings.fence.beyond_m
    on[BELOW] = commanded & (below_m > settings.fence.beyond_m)
    return on


def _beyond_m(seen: Seen, within_s: float) -> tuple[Array, Array]:
    """(n,) how far outside the fence everybody will be, over the ground or above it; and below it."""
    soon_m = seen.position_m + within_s * seen.velocity_m_s
    away_m = np.hypot(soon_m[:, 0], soon_m[:, 1]) - seen.fence.distance_max_m
    return np.maximum(away_m, -soon_m[:, 2] - seen.fence.height_max_m), seen.fence.height_min_m + soon_m[:, 2]


def is_calm(on: Mask, known: Known, seen: Seen, settings: ReactionSettings, *, too_windy: bool) -> bool:
    """Whether nothing happens, nor did: then `advance` would say so, too."""
    happens = bool(on.any()) or too_windy or known.late_s > settings.service_late.late_s
    stale = seen.target_age_s > settings.target_stale.after_s  # False for NaN
    return known.vehicles.is_idle and known.show.is_idle and not (happens or stale)


def advance(
    on: Mask, roles: Roles, seen: Seen, known: Known, settings: ReactionSettings, *, too_windy: bool
) -> tuple[Known, tuple[Wish, ...]]:
    """Which reactions are wanted now.

    Args:
        on: (7, n), of `look`.
        roles: who is what.
        seen: this tick's.
        known: of `look`.
        settings: thresholds and actions.
        too_windy: of `look`.

    Returns: for the next tick; and every reaction whose cause lasts, the most severe first.
    """
    now_s, flies = seen.time_s, roles.flying
    befalls = on & flies
    befalls[LOST] = roles.lost
    befalls[BELOW] &= roles.formed
    battery, position = settings.low_battery, settings.bad_position
    sudden_s = min(position.for_s, AT_ONCE_S)
    fence_s = settings.fence.for_s
    for_s = np.array([0.0, battery.for_s, battery.for_s, position.for_s, sudden_s, fence_s, fence_s])
    vehicles = known.vehicles.next(befalls, now_s, for_s[:, None], settings.clear_s)
    gone = ~flies & ~roles.lost  # down, a pilot's, or not heard yet: nothing is left to react to
    if gone.any():
        vehicles = replace(vehicles, since_s=np.where(gone, np.nan, vehicles.since_s))
    lost, all_count = int(roles.lost.sum()), int((flies | roles.lost).sum())
    many = settings.vehicles_lost
    shows = np.array(
        [
            [too_windy and flies.any()],
            [lost >= many.count and lost >= many.share * all_count and flies.any()],
            [seen.target_age_s > settings.target_stale.after_s and flies.any()],
            [known.late_s > settings.service_late.late_s and flies.any()],
        ]
    )
    show_for_s = np.array([[settings.wind.for_s], [0.0], [0.0], [settings.service_late.for_s]])
    show = known.show.next(shows, now_s, show_for_s, settings.clear_s)
    if not flies.any():
        show = Latch.idle(len(OF_THE_SHOW), 1)
    after = replace(known, vehicles=vehicles, show=show)
    if not (vehicles.active.any() or show.active.any()):
        return after, ()
    wishes = [
        *_of_vehicles(vehicles, seen, after, settings),
        *_of_the_show(show, seen, after, roles, settings, f"{lost} of {all_count} are lost"),
    ]
    wanted = [wish for wish in wishes if wish.action is not Action.IGNORE]
    return after, tuple(sorted(wanted, key=lambda wish: -wish.severity))


def _of_vehicles(latch: Latch, seen: Seen, known: Known, settings: ReactionSettings) -> list[Wish]:
    """One for each cause and action, with the vehicles concerned."""
    battery, position = settings.low_battery, settings.bad_position
    critical = latch.active[CRITICAL]
    told = {
        LOST: "silent, or killed: the others go on without",
        LOW: f"battery at {_least(seen.battery, latch.active[LOW]):.0%}, below {battery.below:.0%}",
        CRITICAL: f"battery at {_least(seen.battery, critical):.0%}, below {battery.critical_below:.0%}",
        SUDDEN: _sudden(seen, known, latch.active[SUDDEN], settings),
        POOR: _poor(seen, latch.active[POOR], settings),
        OUT: f"outside the fence within {settings.fence.within_s:g} s as it flies now",
        BELOW: f"below the fence within {settings.fence.within_s:g} s as it flies now",
    }
    wishes = []
    for kind in np.flatnonzero(latch.active.any(axis=1)).tolist():
        active = latch.active[kind]
        first, later = active, np.zeros_like(active)
        action = then = _ACTION_OF[kind](settings)
        if kind in {POOR, SUDDEN} and position.then_land_after_s is not None:
            later = active & (seen.time_s - latch.since_s[kind] >= position.then_land_after_s)
            first, then = active & ~later, Action.LAND
        for does, rows in ((action, first), (then, later)):
            if rows.any():
                since_s = float(latch.since_s[kind][rows].min())
                named = tuple(np.flatnonzero(rows).tolist())
                wishes.append(Wish(OF_VEHICLES[kind], does, since_s, named, kind == LOST, told[kind]))
    return wishes


_ACTION_OF: Final = {
    LOST: lambda settings: Action(settings.vehicle_lost.action),
    LOW: lambda settings: Action(settings.low_battery.action),
    CRITICAL: lambda settings: Action(settings.low_battery.critical_action),
    POOR: lambda settings: Action(settings.bad_position.action),
    SUDDEN: lambda settings: Action(settings.bad_position.action),
    OUT: lambda settings: Action(settings.fence.action),
    BELOW: lambda settings: Action(settings.fence.action),
}


def _least(values: Array, rows: Mask) -> float:
    return float(np.nanmin(values[rows], initial=1.0))


def _sudden(seen: Seen, known: Known, rows: Mask, settings: ReactionSettings) -> str:
    """Why these positions are bad at once."""
    position = settings.bad_position
    if (seen.time_s - known.jumps_s[0][rows] <= position.jumps_within_s).any():
        return f"its position jumped {position.jumps} times within {position.jumps_within_s:g} s"
    return "its position jumped to where it cannot be"


def _poor(seen: Seen, rows: Mask, settings: ReactionSettings) -> str:
    """Why these positions are bad."""
    position = settings.bad_position
    worst_m = float(np.nanmax(seen.horizontal_m[rows], initial=0.0))
    up_m = float(np.nanmax(seen.vertical_m[rows], initial=0.0))
    most = f"at most {position.horizontal_max_m:g} m and {position.vertical_max_m:g} m are flown with"
    return f"accuracy {worst_m:.1f} m sideways, {up_m:.1f} m up: {most}"


def _of_the_show(
    latch: Latch, seen: Seen, known: Known, roles: Roles, settings: ReactionSettings, losses: str
) -> list[Wish]:
    """One for each cause."""
    wind, late = settings.wind, settings.service_late
    error_m_s = np.hypot(known.error_m_s[:, 0], known.error_m_s[:, 1])
    strays = int((error_m_s > wind.speed_error_m_s).sum())
    rows = {Cause.VEHICLES_LOST: tuple(np.flatnonzero(roles.lost).tolist())}
    cases = {
        Cause.WIND: (
            wind.action,
            wind.then_return_after_s,
            f"{strays} fly up to {error_m_s.max(initial=0.0):.1f} m/s otherwise than they are told",
        ),
        Cause.VEHICLES_LOST: (settings.vehicles_lost.action, None, losses),
        Cause.TARGET_STALE: (
            settings.target_stale.action,
            None,
            f"the live target was not renewed for more than {settings.target_stale.after_s:g} s",
        ),
        Cause.SERVICE_LATE: (
            late.action,
            late.then_return_after_s,
            f"ticks are {known.late_s * 1e3:.0f} ms late on average, at most {late.late_s * 1e3:.0f} ms",
        ),
    }
    wishes = []
    for kind in np.flatnonzero(latch.active[:, 0]).tolist():
        cause, since_s = OF_THE_SHOW[kind], float(latch.since_s[kind, 0])
        name, then_after_s, reason = cases[cause]
        action = Action(name)
        waited_s = min(seen.time_s - since_s, roles.paused_s)
        if action is Action.PAUSE and then_after_s is not None and waited_s >= then_after_s:
            action, reason = Action.RETURN, f"{reason}; a pause of {then_after_s:g} s did not help"
        wishes.append(Wish(cause, action, since_s, rows.get(cause, ()), True, reason))
    return wishes
