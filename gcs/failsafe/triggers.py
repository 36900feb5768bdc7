"""Decides which failsafes are requested: pure, for the whole fleet at once.

A cause begins when it has held for some time, and ends when it has been absent for `clear_s`: no flapping.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from gcs.estimation.contradictions import Doubt, Doubts
from gcs.failsafe.policy import SEVERITY, Action, Cause, FailsafePolicy, LinksLate
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask
from gcs.safety.fenced_areas import beyond_m
from gcs.safety.walls import Fence

LOST, LOW, CRITICAL, POOR, SUDDEN, OUT, BELOW = range(7)
"""Rows of the conditions of one vehicle."""

OF_VEHICLES: Final = (
    Cause.VEHICLE_LOST,
    Cause.LOW_BATTERY,
    Cause.CRITICAL_BATTERY,
    Cause.BAD_POSITION,
    Cause.BAD_POSITION,
    Cause.FENCE,
    Cause.FENCE,
)

OF_THE_SHOW: Final = (
    Cause.WIND,
    Cause.VEHICLES_LOST,
    Cause.TARGET_STALE,
    Cause.SERVICE_LATE,
    Cause.LINKS_LATE,
    Cause.MANNED_AIRCRAFT,
)

IN_WORDS: Final = {
    Doubt.NONE: "its position jumped to where it cannot be",
    Doubt.STANDS: "its position stands still, though it reports that it moves",
    Doubt.STANDS_COMMANDED: "its position stands still, though setpoints move it",
    Doubt.STRAYS: "its position goes elsewhere than its velocity",
    Doubt.LATE: "its positions arrive late",
}
"""Why a position is not believed, in words."""

AT_ONCE_S = 0.3
"""A vehicle without a plausible position is not commanded; its autopilot notices that within a second."""

SMOOTH_S = 1.0
"""Time constant of the averages of velocity error and lateness."""

BATTERY_BACK: Final = 0.03
"""A battery counts as low until it is above its limit by this share: it recovers a little under less load."""

LATENESS_COUNTS: Final = 4.0
"""One tick counts for at most this many times the limit, so that a single long stall soon stops counting."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Inputs of the triggers in one tick. Rows as in FleetState; NaN where nothing is known."""

    time_s: float
    position_m: Array  # (n, 3) show frame
    velocity_m_s: Array  # (n, 3)
    desired_m_s: Array  # (n, 3) commanded velocity, NaN: not commanded
    battery: Array  # (n,) 0 to 1
    horizontal_m: Array  # (n,) accuracy as reported
    vertical_m: Array  # (n,)
    unbelieved: Mask  # (n,) received lately, but at an impossible position
    doubts: Doubts  # (n,) `Doubt` of the newest position, by its content
    silent: Mask  # (n,) not received lately
    reset_time_s: Array  # (n,) time of the latest position jump, -inf: never
    fence: Fence
    target_age_s: float  # since a live target's update; NaN: there is none
    late_s: float  # delay of the newest tick
    link_late_s: Array  # (n,) delay of telemetry over the least possible
    link_share: Array  # (n,) share of the requested position messages that arrive
    manned: str = ""  # a manned aircraft that is too near, in words; empty: there is none
    may_descend: bool = False  # the formation can, without a written show that leads it
    paused: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Roles:
    """Roles of the vehicles. Rows as in FleetState."""

    flying: Mask  # (n,) in the air, and under control
    formed: Mask  # (n,) of these in formation
    lost: Mask  # (n,) under control when they fell silent, or were killed
    paused_s: float  # how long the show has been paused


@dataclass(frozen=True, eq=False)
class Latch:
    """Conditions, (k, m), that begin after holding for some time, and end after an absence of some time."""

    on_since_s: Array  # (k, m) NaN: does not hold now
    last_on_s: Array  # (k, m) when it held last
    since_s: Array  # (k, m) active since then, NaN: not active

    @staticmethod
    def idle(causes: int, count: int) -> "Latch":
        """Return the initial state, in which no condition has held."""
        never = np.full((causes, count), np.nan)
        return Latch(never, np.full((causes, count), -np.inf), never)

    @cached_property
    def active(self) -> Mask:
        """(k, m) Which conditions are active."""
        return ~np.isnan(self.since_s)

    @cached_property
    def is_idle(self) -> bool:
        """Whether no condition holds or is active: a tick in which none holds would change nothing."""
        return bool(np.isnan(self.on_since_s).all() and np.isnan(self.since_s).all())

    def holds(self, now_s: float, for_s: Array) -> Mask:
        """(k, m) Which conditions hold now, and have for `for_s`: only those grow more severe."""
        return np.asarray(now_s - self.on_since_s >= for_s)  # False for NaN

    def next(self, on: Mask, now_s: float, for_s: Array, clear_s: float) -> "Latch":
        """Return the state after a tick in which `on` (k, m) held; (k, 1) `for_s` is each one's delay."""
        on_since_s = np.where(on, np.fmin(self.on_since_s, now_s), np.nan)
        last_on_s = np.where(on, now_s, self.last_on_s)
        begins = on & (now_s - on_since_s >= for_s)
        goes_on = self.active & (now_s - last_on_s < clear_s)
        since_s = np.where(begins | goes_on, np.fmin(self.since_s, now_s), np.nan)
        return Latch(on_since_s, last_on_s, since_s)


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """State that one tick's triggers pass to the next. Owns its arrays."""

    time_s: float
    error_m_s: Array  # (n, 2) actual minus commanded, averaged
    late_s: float  # averaged
    jumps_s: Array  # (j, n) the last jumps of each position, oldest first
    doubts: Doubts  # (n,) the last of each while its position was not believed
    vehicles: Latch  # (7, n)
    show: Latch  # (6, 1)

    @staticmethod
    def nothing(count: int, now_s: float, settings: FailsafePolicy) -> "Known":
        jumps_s = np.full((settings.bad_position.jumps, count), -np.inf)
        vehicles, show = Latch.idle(len(OF_VEHICLES), count), Latch.idle(len(OF_THE_SHOW), 1)
        return Known(now_s, np.zeros((count, 2)), 0.0, jumps_s, np.zeros(count, np.int64), vehicles, show)


@dataclass(frozen=True, slots=True)
class Weather:
    """Conditions of the fleet as a whole."""

    windy: bool = False  # most velocities differ from their setpoints, over links that are on time
    late: bool = False  # telemetry is late


@dataclass(frozen=True, slots=True)
class FailsafeRequest:
    """One requested failsafe, for as long as its cause lasts."""

    cause: Cause
    action: Action
    since_s: float
    rows: tuple[int, ...]  # concerned; empty: no single vehicle
    whole_show: bool  # whether the action is the show's
    reason: str
    holds: bool = True  # the cause holds now; False: it ended less than `clear_s` ago

    @property
    def severity(self) -> int:
        return SEVERITY[self.action]


def look(seen: Seen, memory: Known, settings: FailsafePolicy) -> tuple[Known, Mask, Weather]:
    """Evaluate the conditions that follow from telemetry; cheap, once a tick.

    Returns: updated averages; (7, n) conditions of each vehicle if it flies (see OF_VEHICLES); and conditions
    of the fleet as a whole.
    """
    dt_s = max(seen.time_s - memory.time_s, 0.0)
    share = min(1.0, dt_s / SMOOTH_S)
    late_s = min(seen.late_s, LATENESS_COUNTS * settings.service_late.late_s)
    late_s = memory.late_s + share * (late_s - memory.late_s)
    jumped = seen.reset_time_s > memory.jumps_s[-1]
    jumps_s = memory.jumps_s
    if np.count_nonzero(jumped):
        jumps_s = np.where(jumped, np.vstack([jumps_s[1:], seen.reset_time_s]), jumps_s)
    wind, links, position = settings.wind, settings.links_late, settings.bad_position
    battery, fence = settings.low_battery, settings.fence
    error_m_s, on, (commanded, strays, poor, poor_strays) = _look(
        # numba compiles frozen arrays as another type
        (np.array(seen.position_m), np.array(seen.velocity_m_s), np.array(seen.desired_m_s)),
        (np.array(seen.battery), np.array(seen.horizontal_m), np.array(seen.vertical_m)),
        (np.array(seen.link_late_s), np.array(seen.link_share), jumps_s[0]),
        (np.array(seen.unbelieved), np.array(seen.silent)),
        memory.vehicles.active,
        memory.error_m_s,
        (seen.time_s, share, wind.speed_error_m_s, links.late_s, links.arrive_min),
        (battery.below, battery.critical_below),
        (position.horizontal_max_m, position.vertical_max_m, position.jumps_within_s),
        (fence.within_s, fence.beyond_m),
        (seen.fence.distance_max_m, seen.fence.height_min_m, seen.fence.height_max_m),
    )
    if seen.fence.areas:
        soon_m = np.asarray(seen.position_m + fence.within_s * seen.velocity_m_s)
        on[OUT] |= beyond_m(seen.fence.areas, soon_m) > fence.beyond_m
    too_windy = bool(strays and strays >= wind.share * commanded)
    # Late setpoints also make velocities differ: it is wind only where links are on time.
    by_links = 2 * poor_strays > strays
    many_poor = bool(poor and poor >= links.share * commanded)
    weather = Weather(windy=too_windy and not by_links, late=many_poor or (too_windy and by_links))
    doubts = memory.doubts
    if np.count_nonzero(doubts | seen.doubts):
        # kept while the failsafe lasts: it is doubted until it moves only
        kept = np.where(memory.vehicles.active[SUDDEN], doubts, Doubt.NONE)
        doubts = np.where(seen.unbelieved & (seen.doubts != Doubt.NONE), seen.doubts, kept)
    averages = Known(seen.time_s, error_m_s, late_s, jumps_s, doubts, memory.vehicles, memory.show)
    return averages, on, weather


@kernel
def _is_poor(late_s: float, share: float, late_max_s: float, arrive_min: float) -> bool:
    """Whether a link delivers too late, or too few of its messages; false for NaN."""
    return late_s > late_max_s or share < arrive_min


@kernel
def _look(
    motion: tuple[Array, Array, Array],
    reported: tuple[Array, Array, Array],
    received: tuple[Array, Array, Array],
    doubts: tuple[Mask, Mask],
    active: Mask,
    before_m_s: Array,
    about: tuple[float, float, float, float, float],
    batteries: tuple[float, float],
    positions: tuple[float, float, float],
    fence: tuple[float, float],
    bounds: tuple[float, float, float],
) -> tuple[Array, Mask, tuple[int, int, int, int]]:
    """Averaged velocity errors (n, 2), conditions (7, n), and four numbers of vehicles.

    The vehicles are those commanded, those off their velocities, commanded ones with poor links, and those
    of these that are off.

    Args:
        motion: positions, velocities and desired velocities (n, 3), as of `Seen`, and so are the next.
        reported: battery and accuracies, sideways and up, (n,).
        received: delay of the link, share of its messages, and the oldest of the last jumps, (n,).
        doubts: not believed, and silent, (n,).
        active: (7, n) as before.
        before_m_s: (n, 2) averaged errors before.
        about: time, share of the new error, greatest error, greatest delay, least share of messages.
        batteries: low and critical.
        positions: greatest accuracies sideways and up, and how recent jumps are.
        fence: of how soon, and how far beyond.
        bounds: greatest distance, least and greatest height.
    """
    time_s, share, error_max_m_s, late_max_s, arrive_min = about
    position_m, velocity_m_s, desired_m_s = motion
    battery, horizontal_m, vertical_m = reported
    link_late_s, link_share, first_jump_s = received
    unbelieved, silent = doubts
    within_s, beyond_m = fence
    n = len(battery)
    error_m_s, on = np.zeros((n, 2)), np.zeros((len(OF_VEHICLES), n), np.bool_)
    commanded, strays, poor, poor_strays = 0, 0, 0, 0
    for i in range(n):
        x_m_s, y_m_s = velocity_m_s[i, 0] - desired_m_s[i, 0], velocity_m_s[i, 1] - desired_m_s[i, 1]
        is_commanded = np.isfinite(x_m_s) and np.isfinite(y_m_s)
        if is_commanded:
            commanded += 1
            error_m_s[i, 0] = before_m_s[i, 0] + share * (x_m_s - before_m_s[i, 0])
            error_m_s[i, 1] = before_m_s[i, 1] + share * (y_m_s - before_m_s[i, 1])
        strays_now = error_m_s[i, 0] ** 2 + error_m_s[i, 1] ** 2 > error_max_m_s**2
        poor_now = is_commanded and _is_poor(link_late_s[i], link_share[i], late_max_s, arrive_min)
        strays, poor = strays + strays_now, poor + poor_now
        poor_strays += strays_now and poor_now
        on[LOST, i] = silent[i]
        on[LOW, i] = battery[i] < batteries[0] + (BATTERY_BACK if active[LOW, i] else 0.0)  # False for NaN
        on[CRITICAL, i] = battery[i] < batteries[1] + (BATTERY_BACK if active[CRITICAL, i] else 0.0)
        on[POOR, i] = horizontal_m[i] > positions[0] or vertical_m[i] > positions[1]
        on[SUDDEN, i] = unbelieved[i] or time_s - first_jump_s[i] <= positions[2]
        # where it is soon, over the ground or above the fence, and below it
        x_m = position_m[i, 0] + within_s * velocity_m_s[i, 0]
        y_m = position_m[i, 1] + within_s * velocity_m_s[i, 1]
        z_m = position_m[i, 2] + within_s * velocity_m_s[i, 2]
        on[OUT, i] = x_m**2 + y_m**2 > (bounds[0] + beyond_m) ** 2 or -z_m - bounds[2] > beyond_m
        on[BELOW, i] = is_commanded and bounds[1] + z_m > beyond_m
    return error_m_s, on, (commanded, strays, poor, poor_strays)


def warm_up() -> None:
    """Compile or load the kernel."""
    settings, still, zero = FailsafePolicy(), np.zeros((1, 3)), np.zeros(1)
    none, fence = np.zeros(1, np.bool_), Fence()
    reported = still, still, still, zero, zero, zero
    doubts = none, np.zeros(1, np.int64), none
    seen = Seen(0.0, *reported, *doubts, zero - np.inf, fence, np.nan, 0.0, zero, zero)
    look(seen, Known.nothing(1, 0.0, settings), settings)


def is_calm(on: Mask, memory: Known, seen: Seen, settings: FailsafePolicy, weather: Weather) -> bool:
    """Whether no condition holds or is active: then `advance` would change nothing."""
    happens = bool(np.count_nonzero(on)) or weather.windy or weather.late
    late = memory.late_s > settings.service_late.late_s
    stale = seen.target_age_s > settings.target_stale.after_s  # False for NaN
    return memory.vehicles.is_idle and memory.show.is_idle and not (happens or late or stale or seen.manned)


def advance(
    on: Mask, roles: Roles, seen: Seen, memory: Known, settings: FailsafePolicy, weather: Weather
) -> tuple[Known, tuple[FailsafeRequest, ...]]:
    """Return the state for the next tick, and every failsafe whose cause lasts, most severe first.

    `on` (7, n), `memory` and `weather` are from `look`.
    """
    now_s, flies = seen.time_s, roles.flying
    befalls = on & flies
    befalls[LOST] = roles.lost
    befalls[BELOW] &= roles.formed
    battery, position = settings.low_battery, settings.bad_position
    sudden_s = min(position.for_s, AT_ONCE_S)
    fence_s = settings.fence.for_s
    for_s = np.array([0.0, battery.for_s, battery.for_s, position.for_s, sudden_s, fence_s, fence_s])
    vehicles = memory.vehicles.next(befalls, now_s, for_s[:, None], settings.clear_s)
    gone = ~flies & ~roles.lost  # landed, under pilot control, or not received yet: no failsafe applies
    if gone.any():
        vehicles = replace(vehicles, since_s=np.where(gone, np.nan, vehicles.since_s))
    lost, all_count = int(roles.lost.sum()), int((flies | roles.lost).sum())
    many = settings.vehicles_lost
    many_lost = lost >= many.count and lost >= many.share * all_count
    stale = seen.target_age_s > settings.target_stale.after_s
    late = memory.late_s > settings.service_late.late_s
    shows = (
        np.array([weather.windy, many_lost, stale, late, weather.late, bool(seen.manned)], dtype=np.bool_)
        & flies.any()
    )
    for_each_s = settings.wind.for_s, 0.0, 0.0, settings.service_late.for_s, settings.links_late.for_s, 0.0
    show_for_s = np.array(for_each_s)[:, None]
    show = memory.show.next(shows[:, None], now_s, show_for_s, settings.clear_s)
    if not flies.any():
        show = Latch.idle(len(OF_THE_SHOW), 1)
    after = replace(memory, vehicles=vehicles, show=show)
    if not (vehicles.active.any() or show.active.any()):
        return after, ()
    losses = f"{lost} of {all_count} are lost"
    requests = [
        *_of_vehicles(vehicles, vehicles.holds(now_s, for_s[:, None]), seen, after, settings),
        *_of_the_show(show, show.holds(now_s, show_for_s), seen, after, roles, settings, losses),
    ]
    desired = [request for request in requests if request.action is not Action.IGNORE]
    return after, tuple(sorted(desired, key=lambda request: -request.severity))


def _of_vehicles(
    latch: Latch, holds: Mask, seen: Seen, memory: Known, settings: FailsafePolicy
) -> list[FailsafeRequest]:
    """Return one request for each cause and action, with the vehicles concerned."""
    battery, position, fence = settings.low_battery, settings.bad_position, settings.fence
    low, critical = (np.nanmin(seen.battery[latch.active[kind]], initial=1.0) for kind in (LOW, CRITICAL))
    soon = f"the fence within {fence.within_s:g} s as it flies now"
    cases = {
        LOST: (settings.vehicle_lost.action, "silent, or killed: the others go on without"),
        LOW: (battery.action, f"battery at {low:.0%}, below {battery.below:.0%}"),
        CRITICAL: (battery.critical_action, f"battery at {critical:.0%}, below {battery.critical_below:.0%}"),
        SUDDEN: (position.action, _sudden(seen, memory, latch.active[SUDDEN], settings)),
        POOR: (position.action, _poor(seen, latch.active[POOR], settings)),
        OUT: (fence.action, f"outside {soon}"),
        BELOW: (fence.action, f"below {soon}"),
    }
    requests = []
    for kind in np.flatnonzero(latch.active.any(axis=1)).tolist():
        active = latch.active[kind]
        first, later = active, np.zeros_like(active)
        name, reason = cases[kind]
        action = then = Action(name)
        if kind in {POOR, SUDDEN} and position.then_land_after_s is not None:
            waited = seen.time_s - latch.since_s[kind] >= position.then_land_after_s
            later = active & waited & holds[kind]
            first, then = active & ~later, Action.LAND
        for does, rows in ((action, first), (then, later)):
            if rows.any():
                since_s, named = float(latch.since_s[kind][rows].min()), tuple(np.flatnonzero(rows).tolist())
                cause, of_show = OF_VEHICLES[kind], kind == LOST
                requests.append(FailsafeRequest(cause, does, since_s, named, of_show, reason))
    return requests


def _sudden(seen: Seen, memory: Known, rows: Mask, settings: FailsafePolicy) -> str:
    position = settings.bad_position
    if (seen.time_s - memory.jumps_s[0][rows] <= position.jumps_within_s).any():
        return f"its position jumped {position.jumps} times within {position.jumps_within_s:g} s"
    return " or ".join(IN_WORDS[Doubt(kind)] for kind in np.unique(memory.doubts[rows]).tolist())


def _poor(seen: Seen, rows: Mask, settings: FailsafePolicy) -> str:
    position = settings.bad_position
    worst_m = float(np.nanmax(seen.horizontal_m[rows], initial=0.0))
    up_m = float(np.nanmax(seen.vertical_m[rows], initial=0.0))
    if np.isinf(max(worst_m, up_m)):
        return "its receiver has no 3D fix"
    most = f"at most {position.horizontal_max_m:g} m and {position.vertical_max_m:g} m are flown with"
    return f"accuracy {worst_m:.1f} m sideways, {up_m:.1f} m up: {most}"


def _of_the_show(
    latch: Latch, holds: Mask, seen: Seen, memory: Known, roles: Roles, settings: FailsafePolicy, losses: str
) -> list[FailsafeRequest]:
    wind, links = settings.wind, settings.links_late
    target, late = settings.target_stale, settings.service_late
    error_m_s = np.hypot(memory.error_m_s[:, 0], memory.error_m_s[:, 1])
    strays = int((error_m_s > wind.speed_error_m_s).sum())
    rows = {Cause.VEHICLES_LOST: tuple(np.flatnonzero(roles.lost).tolist())}
    off = f"{strays} vehicles fly up to {error_m_s.max(initial=0.0):.1f} m/s off their setpoints"
    stale = f"no new position of it for more than {target.after_s:g} s"
    slow = f"ticks are {memory.late_s * 1e3:.0f} ms late on average, {late.late_s * 1e3:.0f} ms is allowed"
    cases = {
        Cause.WIND: (wind.action, wind.then_return_after_s, off),
        Cause.LINKS_LATE: (links.action, links.then_return_after_s, _late_links(seen, roles, links)),
        Cause.VEHICLES_LOST: (settings.vehicles_lost.action, None, losses),
        Cause.MANNED_AIRCRAFT: (_giving_way(seen, settings), None, seen.manned or "it is gone"),
        Cause.TARGET_STALE: (target.action, None, stale),
        Cause.SERVICE_LATE: (late.action, late.then_return_after_s, slow),
    }
    requests = []
    for kind in np.flatnonzero(latch.active[:, 0]).tolist():
        cause, since_s = OF_THE_SHOW[kind], float(latch.since_s[kind, 0])
        name, then_after_s, reason = cases[cause]
        now_holds = bool(holds[kind, 0])
        if not now_holds:
            over_s = seen.time_s - float(latch.last_on_s[kind, 0])
            reason = f"over for {over_s:.0f} s: {reason}" if over_s >= 1.0 else f"over just now: {reason}"
        action = Action(name)
        waited_s = min(seen.time_s - since_s, roles.paused_s)
        did_not_help = then_after_s is not None and waited_s >= then_after_s and now_holds
        if action is Action.PAUSE and did_not_help:
            action, reason = Action.RETURN, f"{reason}; a pause of {then_after_s:g} s did not help"
        requests.append(FailsafeRequest(cause, action, since_s, rows.get(cause, ()), True, reason, now_holds))
    return requests


def _giving_way(seen: Seen, settings: FailsafePolicy) -> str:
    """What the show does for a manned aircraft: one that cannot descend stays paused, or comes home."""
    action = settings.manned_aircraft.action
    if action != "descend" or seen.may_descend:
        return action
    return "pause" if seen.paused else "return"


def _late_links(seen: Seen, roles: Roles, settings: LinksLate) -> str:
    """Return delay and share of the telemetry of flying vehicles, in words."""
    flying = np.flatnonzero(roles.flying)
    if not len(flying):
        return "no vehicle flies"
    late_s, share = seen.link_late_s[flying], seen.link_share[flying]
    limits = settings.late_s, settings.arrive_min
    poor = sum(_is_poor(*each, *limits) for each in zip(late_s.tolist(), share.tolist(), strict=True))
    return (
        f"telemetry of {poor} of {len(flying)} arrives {late_s.mean():.2f} s late, at most"
        f" {settings.late_s:g} s; {share.mean():.0%} of it arrives, at least {settings.arrive_min:.0%}"
    )
